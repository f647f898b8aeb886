#include "cuda/accel/build/bvh_builder.h"

#include <algorithm>
#include <chrono>
#include <vector>

#include "cuda/accel/build/kernels.h"
#include "cuda/accel/kernels.h"
#include "cuda/lanes.h"
#include "error.h"

namespace gpurt::cuda {
namespace {

constexpr const char *build_memory = "building the bvh";

// Splits in space add at most this many references: as many as there are, as on the host, but to large scenes, whose
// triangles are mostly small and whose memory matters, half of that.
uint32_t spare_references(uint32_t count)
{
  constexpr uint32_t large_scene = 8u << 20;
  return std::min(std::max(std::min(count, large_scene / 2), count / 2), bvh_max_references - count);
}

double seconds_since(std::chrono::steady_clock::time_point start)
{
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

class Builder {
 public:
  Builder(const SceneView &view, const Group &group, const std::shared_ptr<DeviceMemory> &memory,
          cudaStream_t stream)
      : view_(view), group_(group), memory_(memory), stream_(stream)
  {
    state_.level.scene = {view.positions, view.indices + group.first_triangle};
  }

  DeviceBvh build()
  {
    const auto start = std::chrono::steady_clock::now();
    DeviceBvh tree;
    if (group_.num_triangles == 0) return tree;
    if (group_.num_triangles > bvh_max_references) {
      fail(GPURT_ERROR_UNSUPPORTED,
           "a bvh can refer to {} primitives, not {}; split the geometry or use the kdtree accelerator",
           bvh_max_references, group_.num_triangles);
    }
    Event event[4];
    // Whatever happens, kernels end before the buffers go.
    const WaitAtEnd wait(stream_);
    event[0].record(stream_);
    const uint32_t count = make_references();
    tree.is_complete = count == group_.num_triangles;
    if (count != 0) {
      tree.bounds = box_of(counters_.bounds);
      tree.frame = make_bvh_frame(tree.bounds);
      event[1].record(stream_);
      split_all(count, tree);
      event[2].record(stream_);
      lay_out(tree);
      event[3].record(stream_);
      event[3].wait();
      tree.reference_seconds = seconds_between(event[0], event[1]);
      tree.split_seconds = seconds_between(event[1], event[2]);
      tree.layout_seconds = seconds_between(event[2], event[3]);
    }
    tree.peak_bytes = peak_bytes_;
    tree.seconds = seconds_since(start);
    return tree;
  }

 private:
  void read_counters()
  {
    check(
        cudaMemcpyAsync(&counters_, state_.level.counters, sizeof counters_, cudaMemcpyDeviceToHost, stream_),
        "cudaMemcpyAsync");
    check(cudaStreamSynchronize(stream_), "cudaStreamSynchronize");
  }

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

  // One a triangle with an area; their number.
  uint32_t make_references()
  {
    const uint32_t num_triangles = group_.num_triangles;
    most_ = num_triangles + spare_references(num_triangles);
    counters_buffer_ = allocate<BuildCounters>(1);
    state_.level.counters = counters_buffer_.data();
    for (auto &buffer : references_) buffer = allocate<BuildReference>(most_);
    launch_make_references(state_.level.scene, num_triangles, references_[0].data(), state_.level.counters,
                           stream_);
    read_counters();
    state_.level.from = references_[0].data();
    state_.level.to = references_[1].data();
    const uint32_t count = num_triangles - counters_.num_degenerate;
    if (count == num_triangles || count == 0) return count;
    auto scratch = allocate<std::byte>(drop_scratch_bytes(num_triangles));
    auto num_kept = allocate<uint32_t>(1);
    launch_drop_empty(references_[0].data(), num_triangles, references_[1].data(), num_kept.data(),
                      scratch.data(), scratch.bytes(), stream_);
    check(cudaStreamSynchronize(stream_), "cudaStreamSynchronize");
    free(scratch);
    free(num_kept);
    state_.level.from = references_[1].data();
    state_.level.to = references_[0].data();
    return count;
  }

  // Makes room for the children of `num_split` nodes.
  void reserve_nodes(uint64_t num_split)
  {
    for (uint32_t c = MediumNode; c <= LargeNode; ++c) {
      DeviceBuffer<uint32_t> &list = lists_[next_][c];
      if (list.size() >= 2 * num_split) continue;
      free(list);
      list = allocate<uint32_t>(3 * num_split + 64);
    }
    if (spatial_list_.size() < num_split) {
      free(spatial_list_);
      spatial_list_ = allocate<uint32_t>(3 * num_split / 2 + 64);
    }
    state_.level.spatial_list = spatial_list_.data();
    for (uint32_t c = 0; c < 4; ++c) {
      state_.level.next_list[c] = lists_[next_][c].data();
      state_.level.list[c] = lists_[next_ ^ 1][c].data();
    }
    const uint64_t needed = counters_.num_nodes + 2 * num_split;
    if (needed <= nodes_.size()) return;
    auto larger = allocate<BuildNode>(std::max<uint64_t>(needed, nodes_.size() * 3 / 2));
    if (nodes_.size() != 0) {
      check(cudaMemcpyAsync(larger.data(), nodes_.data(), counters_.num_nodes * sizeof(BuildNode),
                            cudaMemcpyDeviceToDevice, stream_),
            "cudaMemcpyAsync");
      check(cudaStreamSynchronize(stream_), "cudaStreamSynchronize");
    }
    std::swap(nodes_, larger);
    free(larger);
    state_.level.nodes = nodes_.data();
  }

  void split_all(uint32_t count, const DeviceBvh &tree)
  {
    const uint32_t spare = spare_references(count), most = count + spare;
    state_.level.frame = tree.frame;
    state_.level.scale = area_scale(tree.bounds);
    state_.level.root_area = scaled_half_area(tree.bounds, state_.level.scale);
    small_nodes_ = allocate<BvhNode>(most);
    small_references_ = allocate<uint32_t>(most);
    state_.level.small_nodes = small_nodes_.data();
    state_.level.small_references = small_references_.data();
    const uint64_t max_large = most / block_node_size;
    large_ = allocate<LargeSplit>(max_large);
    chunks_ = allocate<SplitChunk>(max_large == 0 ? 0 : most / chunk_size + max_large);
    state_.large = large_.data();
    state_.chunks = chunks_.data();
    // Most nodes of a tree are within small subtrees.
    counters_.num_nodes = 0;
    reserve_nodes(count / 16 + 64);
    launch_make_root(state_, count, spare, stream_);
    next_ ^= 1;
    counters_.num_nodes = 1;
    counters_.num_level_references = count;
    for (uint32_t &n : counters_.num_of_class) n = 0;
    ++counters_.num_of_class[class_of(count)];
    level_begin_ = {0};
    while (level_begin_.back() != counters_.num_nodes) {
      const uint32_t begin = level_begin_.back(), end = counters_.num_nodes;
      level_begin_.push_back(end);
      const uint32_t num_split = end - begin - counters_.num_of_class[SmallNode];
      if (num_split == 0) break;
      reserve_nodes(num_split);
      // What is counted anew on every level stands last.
      check(cudaMemsetAsync(&state_.level.counters->num_level_references, 0,
                            sizeof(BuildCounters) - offsetof(BuildCounters, num_level_references), stream_),
            "cudaMemsetAsync");
      launch_split_level(state_, counters_.num_of_class, counters_.num_level_references, stream_);
      read_counters();
      BuildReference *const from = const_cast<BuildReference *>(state_.level.from);
      state_.level.from = state_.level.to;
      state_.level.to = from;
      next_ ^= 1;
    }
    launch_build_small(state_, counters_.num_nodes, stream_);
    check(cudaStreamSynchronize(stream_), "cudaStreamSynchronize");
    for (auto &lists : lists_) {
      for (auto &list : lists) free(list);
    }
    free(spatial_list_);
    for (auto &buffer : references_) free(buffer);
    free(large_);
    free(chunks_);
  }

  void lay_out(DeviceBvh &tree)
  {
    for (size_t level = level_begin_.size() - 1; level-- != 0;)
      launch_sum_up(state_, level_begin_[level], level_begin_[level + 1], stream_);
    BuildNode root;
    check(cudaMemcpyAsync(&root, state_.level.nodes, sizeof root, cudaMemcpyDeviceToHost, stream_),
          "cudaMemcpyAsync");
    check(cudaStreamSynchronize(stream_), "cudaStreamSynchronize");
    tree.nodes = allocate<BvhNode>(root.num_inner);
    tree.triangles = allocate<LeafTriangle>(root.num_references);
    references_list_ = allocate<uint32_t>(root.num_references);
    const BuildTarget target = {tree.nodes.data(), references_list_.data()};
    for (size_t level = 0; level + 1 < level_begin_.size(); ++level)
      launch_place(state_, level_begin_[level], level_begin_[level + 1], target, stream_);
    launch_place_small(state_, counters_.num_nodes, target, stream_);
    launch_gather_leaf_triangles(view_, group_.first_triangle, references_list_.data(), root.num_references,
                                 tree.triangles.data(), stream_);
    tree.root = word_of(root);
    tree.depth = root.height;
    tree.built_sah_cost = tree.sah_cost =
        state_.level.root_area > 0 ? double(root.cost) / double(state_.level.root_area) : 0.0;
  }

  const SceneView &view_;
  const Group &group_;
  const std::shared_ptr<DeviceMemory> &memory_;
  const cudaStream_t stream_;
  BuildState state_{};
  BuildCounters counters_{};
  uint32_t most_ = 0;
  std::vector<uint32_t> level_begin_;  // and the end of the last one
  uint64_t held_bytes_ = 0, peak_bytes_ = 0;
  DeviceBuffer<BuildCounters> counters_buffer_;
  DeviceBuffer<BuildReference> references_[2];
  DeviceBuffer<BuildNode> nodes_;
  DeviceBuffer<uint32_t> lists_[2][4], spatial_list_;
  uint32_t next_ = 0;  // which of the lists are the next level's
  DeviceBuffer<LargeSplit> large_;
  DeviceBuffer<SplitChunk> chunks_;
  DeviceBuffer<BvhNode> small_nodes_;
  DeviceBuffer<uint32_t> small_references_, references_list_;
};

}  // namespace

DeviceBvh build_bvh_on_device(const SceneView &view, const Group &group,
                              const std::shared_ptr<DeviceMemory> &memory, cudaStream_t stream)
{
  return Builder(view, group, memory, stream).build();
}

}  // namespace gpurt::cuda
