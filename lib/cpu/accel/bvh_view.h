// The bvh accelerator as the CPU's kernels read it.
#pragma once

#include "core/accel/bvh.h"
#include "core/scene/scene_view.h"
#include "cpu/accel/triangle_block.h"

namespace gpurt {

struct CpuBvhGroup {
  BvhView tree;  // a leaf's first reference is its first block; there is no list of references
  const TriangleBlock *blocks;
};

/// What CpuAccel::impl points to.
struct CpuBvhView {
  const CpuBvhGroup *groups;
  BvhView placements;  // references are indices into SceneView::placements
  SceneView scene;
};

}  // namespace gpurt
