// A number that identifies what a compiled scene looks like.
#pragma once

#include "scene/compiled_scene.h"

namespace gpurt {

/// 64 bits over everything that decides an image, in an order of its own; the same on every machine.
uint64_t hash_scene(const CompiledScene &scene);

}  // namespace gpurt
