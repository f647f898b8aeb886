#include "cuda/accel/schedule/tracer.h"

#include <algorithm>

#include "cuda/accel/counting/kernels.h"
#include "cuda/accel/near.h"
#include "cuda/layout.h"
#include "error.h"

namespace gpurt::cuda {
namespace {

constexpr uint64_t num_counters = sizeof(DeviceCounters) / sizeof(unsigned long long);
constexpr uint64_t pool_number = num_counters, active_number = num_counters + 1,
                   num_numbers = num_counters + 2;

// Rays whose lists are in memory together: enough to fill the device, a quarter of a gigabyte.
constexpr uint64_t max_list_rays = uint64_t(1) << 18, min_list_rays = uint64_t(1) << 12;

// Rays that the fast kernels trace at a time: more would gain nothing.
constexpr uint64_t max_scratch_rays = uint64_t(1) << 22, min_scratch_rays = uint64_t(1) << 12;

uint64_t bytes_of_hit(HitLayout layout)
{
  return layout == HitLayout::Internal  ? sizeof(Hit)
         : layout == HitLayout::Compact ? sizeof(CompactHit)
                                        : sizeof(FullHit);
}

// Calls take(n) with half as many rays each time that there is no memory for what it takes; returns the last n.
template <class Take>
uint64_t halve_until_it_fits(uint64_t n, uint64_t least, Take &&take)
{
  for (;;) {
    try {
      take(n);
      return n;
    } catch (const Error &e) {
      if (e.result() != GPURT_ERROR_OUT_OF_MEMORY || n <= least) throw;
      n = std::max(n / 2, least);
    }
  }
}

// The part of a batch that begins at `first`.
RayBatch part_of(const RayBatch &batch, uint64_t first, uint64_t most)
{
  RayBatch part = batch;
  part.rays += first;
  part.num_rays = std::min(most, batch.num_rays - first);
  if (part.hits != nullptr)
    part.hits = static_cast<std::byte *>(batch.hits) + first * bytes_of_hit(batch.layout);
  if (part.occluded != nullptr) part.occluded += first;
  return part;
}

uint64_t lay_out(std::byte *base, uint32_t n, LeafListState &state)
{
  Layout layout(base);
  state.capacity = n;
  state.stacks = layout.take<KdEntry>(uint64_t(n) * kd_max_depth);
  state.leaves = layout.take<ListedLeaf>(uint64_t(n) * leaf_list_size);
  state.num_todo = layout.take<uint32_t>(n);
  state.num_leaves = layout.take<uint32_t>(n);
  state.hits = layout.take<Hit>(n);
  for (uint32_t *&active : state.active) active = layout.take<uint32_t>(n);
  return layout.bytes();
}

}  // namespace

bool is_fused(const Schedule &s)
{
  return s.traversal == Traversal::Stack && s.launch != Launch::Persistent && s.fetch == Fetch::PerThread;
}

ScheduledTracer::ScheduledTracer(const Schedule &schedule, const std::shared_ptr<DeviceMemory> &memory,
                                 uint64_t max_rays, cudaStream_t stream, bool counts_lanes)
    : schedule_(schedule), stream_(stream), counts_lanes_(counts_lanes)
{
  numbers_ = DeviceBuffer<unsigned long long>(memory, num_numbers, "counters of a schedule");
  check(cudaMemsetAsync(numbers_.data(), 0, numbers_.bytes(), stream_), "cudaMemsetAsync");
  if (is_persistent_stack()) {
    scratch_rays_ = halve_until_it_fits(
        std::clamp<uint64_t>(max_rays, 1, max_scratch_rays), min_scratch_rays, [&](uint64_t n) {
          scratch_ = DeviceBuffer<uint32_t>(memory, trace_scratch_words(n), "rays on their way");
        });
  }
  if (schedule_.traversal == Traversal::LeafLists) {
    list_capacity_ = uint32_t(
        halve_until_it_fits(std::clamp<uint64_t>(max_rays, 1, max_list_rays), min_list_rays, [&](uint64_t n) {
          LeafListState state;
          lists_ = DeviceBuffer<std::byte>(memory, lay_out(nullptr, uint32_t(n), state), "lists of leaves");
        }));
  }
}

bool ScheduledTracer::is_persistent_stack() const
{
  return schedule_.traversal == Traversal::Stack && schedule_.fetch == Fetch::PerThread &&
         schedule_.launch == Launch::Persistent;
}

RayPool ScheduledTracer::next_pool()
{
  if (schedule_.launch != Launch::Persistent) return {nullptr};
  unsigned long long *pool = numbers_.data() + pool_number;
  check(cudaMemsetAsync(pool, 0, sizeof *pool, stream_), "cudaMemsetAsync");
  return {pool};
}

void ScheduledTracer::trace_lists(const TraceScene &scene, const RayBatch &batch)
{
  auto *counters = reinterpret_cast<DeviceCounters *>(numbers_.data());
  LeafListState state;
  lay_out(lists_.data(), list_capacity_, state);
  state.num_active = numbers_.data() + active_number;
  uint64_t num_active = batch.num_rays;
  const auto select = counts_lanes_ ? counting::launch_select_leaves : launch_select_leaves;
  const auto intersect = counts_lanes_ ? counting::launch_intersect_leaves : launch_intersect_leaves;
  const auto finish = counts_lanes_ ? counting::launch_finish_lists : launch_finish_lists;
  for (bool is_first = true; num_active != 0; is_first = false) {
    select(scene, batch, state, uint32_t(num_active), is_first, next_pool(), counters, stream_);
    check(cudaMemsetAsync(state.num_active, 0, sizeof *state.num_active, stream_), "cudaMemsetAsync");
    intersect(scene, batch, state, uint32_t(num_active), is_first, next_pool(), counters, stream_);
    ++num_rounds_;
    unsigned long long left = 0;
    check(cudaMemcpyAsync(&left, state.num_active, sizeof left, cudaMemcpyDeviceToHost, stream_),
          "cudaMemcpyAsync");
    check(cudaStreamSynchronize(stream_), "cudaStreamSynchronize");
    num_active = left;
    std::swap(state.active[0], state.active[1]);
  }
  finish(scene, batch, state, stream_);
}

void ScheduledTracer::trace_persistent(const TraceScene &scene, const RayBatch &batch,
                                       const TracedRays &known)
{
  auto *counters = reinterpret_cast<DeviceCounters *>(numbers_.data());
  const bool is_any = batch.occluded != nullptr;
  void *results = is_any ? batch.occluded : batch.hits;
  const RayOrder order{Coherence::Incoherent, 0, scratch_.data(), known.left_out, known.ended_at};
  const bool is_unknown = known.leave_surfaces && known.left_out == nullptr;
  if (!is_unknown && has_near_refill(scene) &&
      suits_near_kernels(scene, batch.rays, batch.layout, results, order)) {
    for (uint64_t first = 0; first < batch.num_rays; first += scratch_rays_) {
      const RayBatch part = part_of(batch, first, scratch_rays_);
      RayOrder part_order = order;
      if (part_order.left_out != nullptr) part_order.left_out += first;
      if (part_order.ended_at != nullptr) part_order.ended_at += first;
      (counts_lanes_ ? counting::launch_near_persistent : launch_near_persistent)(
          scene, is_any ? TraceQuery::Any : TraceQuery::Closest, part.rays, uint32_t(part.num_rays),
          part.layout, is_any ? part.occluded : part.hits, part_order, &counters->ray_refills, stream_);
    }
  } else if (scene.has_bvhs) {
    (counts_lanes_ ? counting::launch_persistent_rays : launch_persistent_rays)(scene, batch, next_pool(),
                                                                                counters, stream_);
  } else {
    (counts_lanes_ ? counting::launch_persistent_stack : launch_persistent_stack)(scene, batch, next_pool(),
                                                                                  counters, stream_);
  }
}

void ScheduledTracer::trace(const TraceScene &scene, const RayBatch &batch, const TracedRays &known)
{
  if (batch.num_rays == 0) return;
  auto *counters = reinterpret_cast<DeviceCounters *>(numbers_.data());
  switch (schedule_.traversal) {
    case Traversal::LeafLists:
      for (uint64_t first = 0; first < batch.num_rays; first += list_capacity_)
        trace_lists(scene, part_of(batch, first, list_capacity_));
      return;
    case Traversal::Uber:
      return (counts_lanes_ ? counting::launch_uber : launch_uber)(scene, batch, next_pool(), counters,
                                                                   stream_);
    default:
      if (schedule_.fetch == Fetch::Packets)
        return (counts_lanes_ ? counting::launch_packets : launch_packets)(scene, batch, next_pool(),
                                                                           counters, stream_);
      return trace_persistent(scene, batch, known);
  }
}

void ScheduledTracer::closest(const TraceScene &scene, const Ray *rays, uint64_t num_rays, HitLayout layout,
                              void *hits, const TracedRays &known)
{
  trace(scene, {rays, num_rays, layout, hits, nullptr}, known);
}

void ScheduledTracer::any(const TraceScene &scene, const Ray *rays, uint64_t num_rays, uint8_t *occluded,
                          const TracedRays &known)
{
  trace(scene, {rays, num_rays, HitLayout::Internal, nullptr, occluded}, known);
}

void ScheduledTracer::collect(ScheduleCounters &sum)
{
  DeviceCounters counters{};
  check(cudaMemcpyAsync(&counters, numbers_.data(), sizeof counters, cudaMemcpyDeviceToHost, stream_),
        "cudaMemcpyAsync");
  check(cudaMemsetAsync(numbers_.data(), 0, sizeof counters, stream_), "cudaMemsetAsync");
  check(cudaStreamSynchronize(stream_), "cudaStreamSynchronize");
  sum.ray_refills += counters.ray_refills;
  sum.list_overflows += counters.list_overflows;
  sum.mode_switches += counters.mode_switches;
  sum.packets += counters.packets;
  sum.shared_triangles += counters.shared_triangles;
  sum.list_rounds += num_rounds_;
  num_rounds_ = 0;
}

}  // namespace gpurt::cuda
