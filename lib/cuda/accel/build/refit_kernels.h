// The kernels that refit a bvh as host code calls them.
#pragma once

#include <cuda_runtime_api.h>

#include "core/accel/bvh_accel.h"
#include "core/scene/scene_view.h"
#include "cuda/accel/build/build_node.h"

namespace gpurt::cuda {

struct RefitState {
  const BvhNode *old_nodes;
  uint64_t num_nodes;
  const LeafTriangle *old_triangles;
  LeafTriangle *triangles;
  uint64_t num_triangles;
  uint32_t *parents;    // of node i: its parent's slot; a slot is node * 2 + child
  uint32_t *arrivals;   // at node i
  Box *boxes;           // of slot i
  OrderedBox *bounds;   // of all triangles
  uint32_t *num_empty;  // triangles without an area
};

constexpr unsigned refit_block_size = 128;

/// Reads the triangles anew, and measures them.
void launch_refit_triangles(const RefitState &state, const SceneView &scene, cudaStream_t stream);
/// Boxes of all slots.
void launch_refit_boxes(const RefitState &state, cudaStream_t stream);
/// Nodes over the boxes. costs[i]: of the nodes and leaves of block i, in triangle tests times area.
void launch_refit_nodes(const RefitState &state, const BvhFrame &frame, float scale, BvhNode *nodes,
                        double *costs, cudaStream_t stream);

}  // namespace gpurt::cuda
