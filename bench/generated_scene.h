// Scenes of what glTF files have beside plain triangles, made by code, and rays through them.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "gpurt.h"

namespace bench {

/// Whether `name` is a scene that fill_generated() makes.
bool is_generated(const std::string &name);

/// Adds geometry to a scene:
///   leaves   alpha masks: 400,000 triangles of leaves about 200 trunks, in world space
///   rocks    placements: 10,000 of 5 rocks of 5,000 triangles each, turned and scaled, on a ground
///   forest   both: 10,000 placements of 4 trees of 4,000 masked triangles each and a trunk, on a ground
void fill_generated(const std::string &name, gpurt_scene scene);

/// 2^21 rays a set: "primary", an image of 2048 x 1024; "ao" and "diffuse", from where those hit in any direction, the first of
/// a limited length; "random", between points about the scene. `scene` is committed.
std::map<std::string, std::vector<gpurt_ray>> make_generated_rays(const std::string &name, gpurt_scene scene);
constexpr uint32_t generated_width = 2048;

}  // namespace bench
