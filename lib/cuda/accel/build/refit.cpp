#include "cuda/accel/build/refit.h"

#include <chrono>
#include <numeric>
#include <vector>

#include "cuda/accel/build/refit_kernels.h"
#include "cuda/lanes.h"

namespace gpurt::cuda {

DeviceBvh refit_bvh(const DeviceBvh &old, const SceneView &view, const std::shared_ptr<DeviceMemory> &memory,
                    cudaStream_t stream, bool &fits)
{
  constexpr const char *what = "refitting the bvh";
  const auto start = std::chrono::steady_clock::now();
  fits = true;
  DeviceBvh tree;
  if (old.root == bvh_empty) return tree;
  RefitState state{};
  state.old_nodes = old.nodes.data();
  state.num_nodes = old.nodes.size();
  state.old_triangles = old.triangles.data();
  state.num_triangles = old.triangles.size();
  tree.nodes = DeviceBuffer<BvhNode>(memory, state.num_nodes, what);
  tree.triangles = DeviceBuffer<LeafTriangle>(memory, state.num_triangles, what);
  const DeviceBuffer<uint32_t> parents(memory, state.num_nodes, what),
      arrivals(memory, state.num_nodes, what), num_empty(memory, 1, what);
  const DeviceBuffer<Box> boxes(memory, 2 * state.num_nodes, what);
  const DeviceBuffer<OrderedBox> bounds(memory, 1, what);
  const uint64_t num_blocks = (state.num_nodes + refit_block_size - 1) / refit_block_size;
  const DeviceBuffer<double> costs(memory, num_blocks, what);
  const WaitAtEnd wait(stream);
  state.triangles = tree.triangles.data();
  state.parents = parents.data();
  state.arrivals = arrivals.data();
  state.boxes = boxes.data();
  state.bounds = bounds.data();
  state.num_empty = num_empty.data();
  launch_refit_triangles(state, view, stream);
  OrderedBox measured;
  uint32_t num_degenerate = 0;
  check(cudaMemcpyAsync(&measured, state.bounds, sizeof measured, cudaMemcpyDeviceToHost, stream),
        "cudaMemcpyAsync");
  check(cudaMemcpyAsync(&num_degenerate, state.num_empty, sizeof num_degenerate, cudaMemcpyDeviceToHost,
                        stream),
        "cudaMemcpyAsync");
  if (state.num_nodes != 0) {
    check(cudaMemsetAsync(state.arrivals, 0, arrivals.bytes(), stream), "cudaMemsetAsync");
    launch_refit_boxes(state, stream);
  }
  check(cudaStreamSynchronize(stream), "cudaStreamSynchronize");
  fits = num_degenerate == 0;
  if (!fits) return tree;
  tree.bounds = box_of(measured);
  tree.frame = make_bvh_frame(tree.bounds);
  const float scale = area_scale(tree.bounds), root_area = scaled_half_area(tree.bounds, scale);
  std::vector<double> block_costs(num_blocks);
  if (num_blocks != 0) {
    launch_refit_nodes(state, tree.frame, scale, tree.nodes.data(), costs.data(), stream);
    check(cudaMemcpyAsync(block_costs.data(), costs.data(), costs.bytes(), cudaMemcpyDeviceToHost, stream),
          "cudaMemcpyAsync");
    check(cudaStreamSynchronize(stream), "cudaStreamSynchronize");
  }
  const double cost = num_blocks != 0 ? std::accumulate(block_costs.begin(), block_costs.end(), 0.0)
                                      : double(root_area) * leaf_size(old.root);
  tree.sah_cost = root_area > 0 ? cost / double(root_area) : 0.0;
  tree.root = old.root;
  tree.depth = old.depth;
  tree.built_sah_cost = old.built_sah_cost;
  tree.is_complete = old.is_complete;
  tree.is_refitted = true;
  tree.peak_bytes = tree.nodes.bytes() + tree.triangles.bytes() + parents.bytes() + arrivals.bytes() +
                    boxes.bytes() + costs.bytes();
  tree.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return tree;
}

}  // namespace gpurt::cuda
