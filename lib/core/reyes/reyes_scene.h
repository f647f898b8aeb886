// What the REYES stages read: the committed scene, its patches as they were given, and the settings.
//
// A root is one primitive of one instance: a bicubic patch, which is split and diced, or a triangle, which is flat and
// needs neither. Roots count over the whole scene, so that an id means the same in every tile.
#pragma once

#include "core/path/path_settings.h"
#include "core/reyes/patch_cells.h"
#include "core/scene/scene_view.h"

namespace gpurt {

// The patches of a segment. Its triangles are theirs, patch after patch.
struct PatchRange {
  uint32_t first_patch;  // of ReyesScene::control_points, 16 points each
  uint32_t num_patches;  // 0: the segment is a mesh
};

// Roots [first_root, the next range's first_root): the primitives of a segment through one placement, or in world space.
struct RootRange {
  uint64_t first_root;
  uint32_t segment;
  uint32_t placement;  // invalid_id: world space
};

struct ReyesScene {
  SceneView scene;
  const Vec3f *control_points;
  const PatchRange *patches;  // of each segment
  const PatchCells *cells;    // of each patch
  const RootRange *ranges;    // [num_ranges + 1]; the last one ends the roots
  uint32_t num_ranges;
};

// Values of gpurt_reyes_filter and gpurt_reyes_shading.
enum class ReyesFilter : uint32_t { Auto = 0, Box = 1, Gaussian = 2, Mitchell = 3 };
enum class ReyesShading : uint32_t { Auto = 0, Samples = 1, Micropolygons = 2, Blocks = 3 };

// Resolved settings of the pipeline beside PathSettings.
struct ReyesSettings {
  float shading_rate;  // area of a micropolygon in pixels that is aimed for
  ReyesFilter filter;
  ReyesShading shading;
  uint32_t no_shadows;
  float flatness;  // pixels that micropolygons larger than the rate may leave the surface by; 0: none are
  uint32_t fragment_slots;  // that a sample has for surfaces that blend; 0: as many as it takes
  uint32_t lights_by_rays;  // 1: micropolygons' own light is found after visibility; see lit_point.h
};

// A frame has fewer roots than this: ids are of 32 bits.
constexpr uint64_t max_roots = 0xfffffff0u;

}  // namespace gpurt
