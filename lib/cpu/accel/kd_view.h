// The kd-tree accelerator as the CPU's kernels read it: leaves hold blocks of four triangles, side by side for vector
// instructions.
#pragma once

#include "core/accel/kd_tree.h"
#include "core/accel/ray.h"
#include "core/scene/scene_view.h"

namespace gpurt {

constexpr uint32_t triangles_per_block = 4;

/// Four triangles; the last one is repeated to fill a leaf's last block.
struct alignas(16) TriangleBlock {
  float corner[3][3][triangles_per_block];  // [corner][axis][triangle]
  uint32_t triangle[triangles_per_block];   // indices into SceneView::indices
};

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

struct CpuAccel;

/// Kernels for one combination of triangle test, alpha masks and shared geometries.
struct TraceKernels {
  void (*closest)(const CpuAccel &accel, const Ray *rays, Hit *hits, uint32_t n);
  void (*occluded)(const CpuAccel &accel, const Ray *rays, uint8_t *occluded, uint32_t n);
  /// Calls sink(user, hit) for every crossing, unsorted; a triangle may come several times.
  void (*all)(const CpuAccel &accel, const Ray &ray, void *user, void (*sink)(void *user, const Hit &hit));
};

}  // namespace gpurt
