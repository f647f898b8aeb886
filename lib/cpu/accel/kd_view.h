// The kd-tree accelerator as the CPU's kernels read it: leaves hold blocks of four triangles, side by side for vector
// instructions.
#pragma once

#include "core/accel/kd_tree.h"
#include "core/scene/scene_view.h"
#include "cpu/accel/triangle_block.h"

namespace gpurt {

struct CpuKdGroup {
  KdTreeView tree;  // a leaf's `word` is its first block; there is no list of references
  const TriangleBlock *blocks;
};

/// What CpuAccel::impl points to.
struct CpuKdView {
  const CpuKdGroup *groups;
  KdTreeView placements;  // references are indices into SceneView::placements
  SceneView scene;
};

}  // namespace gpurt
