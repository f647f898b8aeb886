// What rays cost in a bvh and in a kd-tree of one scene, counted rather than timed: the same in every run.
#pragma once

#include "cuda/accel/kernels.h"

namespace gpurt::cuda {

/// What the fast kernels do for rays, all of them together.
struct TreeWork {
  unsigned long long rays, nodes, leaves, triangles;
};

/// Rays that start in the middle of triangles drawn at random, with random directions, as those of bounces do. Both scenes
/// are of the same triangles, and has_near_kernels() holds for them; work[0] is of the bvh, work[1] of the kd-tree.
void launch_probe_trees(const TraceScene &bvh, const TraceScene &kd_tree, uint32_t num_triangles,
                        uint32_t num_rays, TreeWork *work, cudaStream_t stream);

/// Expected time of a ray, in no unit, with what a step, a leaf and a test took on an H100 (docs/kdtree.md).
double expected_time(const TreeWork &work, bool is_kd_tree);

}  // namespace gpurt::cuda
