// The tree that one of many lights is chosen from.
#pragma once

#include <vector>

#include "scene/compiled_scene.h"

namespace gpurt {

/// Builds scene.light_nodes over the first num_tree_lights of scene.lights, which are triangles, points and spots, and
/// sets their tree_path. Geometry, placements and materials are there already.
///
/// A node's power is 4 pi times the largest radiant intensity (luminance, W/sr) of its lights, summed: that of an
/// isotropic emitter as bright. Triangles without area have none; they are leaves that are never chosen.
void build_light_tree(CompiledScene &scene);

}  // namespace gpurt
