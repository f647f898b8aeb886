// The shape of a glTF document: that every member which the loader reads has its type and range, and that every
// reference leads somewhere.
#pragma once

#include "scene/gltf_file.h"

namespace gpurt {

/// Throws IO naming the file, the member by its path in the document, and what is wrong. Whole numbers that are
/// written as reals become integers.
void check_gltf_schema(GltfFile &file);

}  // namespace gpurt
