#include "cuda/accel/build/kd_builder.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <vector>

#include "accel/kd_build.h"
#include "cuda/accel/build/kd_kernels.h"
#include "cuda/accel/build/kernels.h"
#include "cuda/lanes.h"
#include "error.h"

namespace gpurt::cuda {
namespace {

constexpr const char *build_memory = "building the kd-tree";
constexpr uint64_t max_nodes = 0x3fffffffu;

template <class T>
T read_value(const T *from, cudaStream_t stream)
{
  T value;
  check(cudaMemcpyAsync(&value, from, sizeof value, cudaMemcpyDeviceToHost, stream), "cudaMemcpyAsync");
  check(cudaStreamSynchronize(stream), "cudaStreamSynchronize");
  return value;
}

class Builder {
 public:
  Builder(const SceneView &view, const Group &group, const DeviceKdSettings &settings,
          const std::shared_ptr<DeviceMemory> &memory, cudaStream_t stream)
      : group_(group), settings_(settings), memory_(memory), stream_(stream)
  {
    level_.scene = {view.positions, view.indices + group.first_triangle};
    level_.costs.traversal_cost =
        settings.traversal_cost > 0 ? settings.traversal_cost : kd_default_traversal_cost;
    level_.costs.empty_factor = 1.0f - (settings.empty_bonus < 0   ? 0.0f
                                        : settings.empty_bonus > 0 ? settings.empty_bonus
                                                                   : kd_default_empty_bonus);
  }

  DeviceKdTree build()
  {
    const auto start = std::chrono::steady_clock::now();
    if (group_.num_triangles > max_nodes) {
      fail(GPURT_ERROR_UNSUPPORTED, "a kd-tree can refer to 2^30 - 1 primitives, not {}; split the geometry",
           group_.num_triangles);
    }
    DeviceKdTree tree;
    if (group_.num_triangles == 0) return tree;
    // Whatever happens, kernels end before the buffers go.
    const WaitAtEnd wait(stream_);
    const uint32_t count = make_references();
    if (count != 0) {
      tree.bounds = bounds_;
      split_all(count, tree);
      tree.nodes = std::move(nodes_);
      tree.references = std::move(references_);
      tree.num_nodes = num_nodes_;
      tree.num_references = num_references_;
    }
    tree.peak_bytes = peak_bytes_;
    tree.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return tree;
  }

 private:
  template <class T>
  DeviceBuffer<T> allocate(uint64_t count)
  {
    DeviceBuffer<T> buffer(memory_, count, build_memory);
    held_bytes_ += buffer.bytes();
    peak_bytes_ = std::max(peak_bytes_, held_bytes_);
    return buffer;
  }
  template <class T>
  void free(DeviceBuffer<T> &buffer)
  {
    held_bytes_ -= buffer.bytes();
    buffer = {};
  }
  // Makes room for `count` values; what the buffer held is lost.
  template <class T>
  T *reserve(DeviceBuffer<T> &buffer, uint64_t count)
  {
    if (buffer.size() < count) {
      free(buffer);
      buffer = allocate<T>(count + count / 4);
    }
    return buffer.data();
  }
  // Makes room for `count` values, of which there are `held`.
  template <class T>
  T *extend(DeviceBuffer<T> &buffer, uint64_t held, uint64_t count)
  {
    if (buffer.size() < count) {
      auto larger = allocate<T>(std::max(count, buffer.size() * 3 / 2));
      if (held != 0) {
        check(cudaMemcpyAsync(larger.data(), buffer.data(), held * sizeof(T), cudaMemcpyDeviceToDevice,
                              stream_),
              "cudaMemcpyAsync");
        check(cudaStreamSynchronize(stream_), "cudaStreamSynchronize");
      }
      std::swap(buffer, larger);
      free(larger);
    }
    return buffer.data();
  }

  // One a triangle with an area; their number.
  uint32_t make_references()
  {
    const uint32_t num_triangles = group_.num_triangles;
    auto counters = allocate<BuildCounters>(1);
    from_ = allocate<BuildReference>(num_triangles);
    launch_make_references(level_.scene, num_triangles, from_.data(), counters.data(), stream_);
    const BuildCounters made = read_value(counters.data(), stream_);
    free(counters);
    const uint32_t count = num_triangles - made.num_degenerate;
    if (count == 0) return 0;
    bounds_ = box_of(made.bounds);
    if (count == num_triangles) return count;
    to_ = allocate<BuildReference>(count);
    auto scratch = allocate<std::byte>(drop_scratch_bytes(num_triangles));
    auto num_kept = allocate<uint32_t>(1);
    launch_drop_empty(from_.data(), num_triangles, to_.data(), num_kept.data(), scratch.data(),
                      scratch.bytes(), stream_);
    check(cudaStreamSynchronize(stream_), "cudaStreamSynchronize");
    free(scratch);
    free(num_kept);
    std::swap(from_, to_);
    return count;
  }

  void split_all(uint32_t count, DeviceKdTree &tree)
  {
    level_.costs.max_depth =
        settings_.max_depth != 0 ? settings_.max_depth : uint32_t(8.0 + 1.3 * std::log2(double(count)));
    level_.costs.max_depth = std::min(level_.costs.max_depth, uint32_t(kd_max_depth));
    const double x = double(bounds_.hi.x) - bounds_.lo.x, y = double(bounds_.hi.y) - bounds_.lo.y,
                 z = double(bounds_.hi.z) - bounds_.lo.z;
    const double root_area = x * y + y * z + z * x;
    const KdBuildCell root = {
        bounds_, 0, count,
        uint32_t(std::min<uint64_t>(count * kd_max_references_per_primitive, 0xffffffffu))};
    copy_to_device(reserve(cells_, 1), std::span(&root, 1), stream_);
    const uint32_t zero = 0;
    copy_to_device(reserve(large_, 1), std::span(&zero, 1), stream_);
    auto num_large = allocate<uint32_t>(1);
    level_.num_next_large = num_large.data();
    level_.num_large = count > kd_small_cell ? 1 : 0;
    level_.num_cells = 1;
    extend(nodes_, 0, uint64_t(count) * 3);
    extend(references_, 0, uint64_t(count) * 2);
    std::vector<double> costs;
    for (level_.depth = 0; level_.num_cells != 0; ++level_.depth) {
      const uint32_t n = level_.num_cells;
      if (num_nodes_ + n > max_nodes) {
        fail(GPURT_ERROR_UNSUPPORTED,
             "the kd-tree has more than {} nodes; raise traversal_cost or lower max_depth", max_nodes);
      }
      level_.from = from_.data();
      level_.cells = cells_.data();
      level_.large = large_.data();
      level_.choices = reserve(choices_, n);
      level_.sums = reserve(sums_, uint64_t(n) + 1);
      launch_kd_choose(level_, stream_);
      const uint64_t scratch_bytes = kd_sum_bytes(n);
      launch_kd_sum(level_, reserve(scratch_, scratch_bytes), scratch_bytes, stream_);
      const uint32_t num_blocks = (n + kd_cost_block - 1) / kd_cost_block;
      launch_kd_cost(level_, root_area, reserve(cost_sums_, num_blocks), stream_);
      const KdLevelSums all = read_value(level_.sums + n, stream_);
      costs.resize(num_blocks);
      check(cudaMemcpyAsync(costs.data(), cost_sums_.data(), num_blocks * sizeof(double),
                            cudaMemcpyDeviceToHost, stream_),
            "cudaMemcpyAsync");
      check(cudaStreamSynchronize(stream_), "cudaStreamSynchronize");
      for (const double cost : costs) tree.sah_cost += cost;
      if (all.splits != n) tree.depth = level_.depth;

      level_.to = reserve(to_, all.references);
      level_.next_cells = reserve(next_cells_, 2 * uint64_t(all.splits));
      level_.next_large = reserve(next_large_, all.references / kd_small_cell);
      level_.nodes = extend(nodes_, num_nodes_, num_nodes_ + n);
      level_.references = extend(references_, num_references_, num_references_ + all.leaf_references);
      level_.first_node = uint32_t(num_nodes_);
      level_.first_reference = uint32_t(num_references_);
      check(cudaMemsetAsync(num_large.data(), 0, sizeof(uint32_t), stream_), "cudaMemsetAsync");
      launch_kd_partition(level_, stream_);
      level_.num_large = read_value(num_large.data(), stream_);
      level_.num_cells = 2 * all.splits;
      num_nodes_ += n;
      num_references_ += all.leaf_references;
      std::swap(from_, to_);
      std::swap(cells_, next_cells_);
      std::swap(large_, next_large_);
    }
  }

  const Group &group_;
  const DeviceKdSettings settings_;
  const std::shared_ptr<DeviceMemory> &memory_;
  const cudaStream_t stream_;
  KdLevel level_{};
  Box bounds_{};
  uint64_t num_nodes_ = 0, num_references_ = 0;
  uint64_t held_bytes_ = 0, peak_bytes_ = 0;
  DeviceBuffer<BuildReference> from_, to_;
  DeviceBuffer<KdBuildCell> cells_, next_cells_;
  DeviceBuffer<uint32_t> large_, next_large_;
  DeviceBuffer<KdChoice> choices_;
  DeviceBuffer<KdLevelSums> sums_;
  DeviceBuffer<std::byte> scratch_;
  DeviceBuffer<double> cost_sums_;
  DeviceBuffer<KdNode> nodes_;
  DeviceBuffer<uint32_t> references_;
};

}  // namespace

DeviceKdTree build_kd_tree_on_device(const SceneView &view, const Group &group,
                                     const DeviceKdSettings &settings,
                                     const std::shared_ptr<DeviceMemory> &memory, cudaStream_t stream)
{
  return Builder(view, group, settings, memory, stream).build();
}

}  // namespace gpurt::cuda
