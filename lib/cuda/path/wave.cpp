#include "cuda/path/wave.h"

#include <algorithm>

#include "cuda/layout.h"
#include "cuda/path/sort_hits.h"
#include "cuda/path/uber_path.h"

namespace gpurt::cuda {

void StageClock::record(cudaStream_t stream, PathStage stage)
{
  if (events_.size() == stages_.size()) events_.push_back(std::make_unique<Event>());
  events_[stages_.size()]->record(stream);
  stages_.push_back(stage);
}

void StageClock::collect(double (&seconds)[uint32_t(PathStage::Count)])
{
  for (size_t i = 1; i < stages_.size(); ++i) {
    if (stages_[i] != PathStage::Count)
      seconds[uint32_t(stages_[i])] += seconds_between(*events_[i - 1], *events_[i]);
  }
  stages_.clear();
}

namespace {

struct WaveArrays {
  PathWave wave;
  uint32_t *block_counts, *largest, *trace_scratch;
  uint32_t *flags[2], *places[2];
  std::byte *placement_memory, *sort_memory;
  uint64_t placement_bytes, sort_bytes;
  unsigned long long *uber_numbers;
  uint64_t bytes;
};

WaveArrays lay_out(std::byte *base, uint64_t n, const Schedule &schedule)
{
  const bool counted = schedule.generation == Generation::Counted;
  // Counted rays lie in their queues at once: nothing has slots, and queues are no longer than the budget.
  const uint64_t num_slots = counted ? 0 : n;
  const uint64_t queue = counted && schedule.ray_budget != 0 ? std::min(n, schedule.ray_budget) : n;
  Layout layout(base);
  WaveArrays a;
  a.wave.paths = layout.take<PathState>(n);
  a.wave.rays = {layout.take<Ray>(n), layout.take<uint32_t>(n)};
  a.wave.hits = layout.take<Hit>(n);
  a.wave.next_rays = {layout.take<Ray>(queue), layout.take<uint32_t>(queue)};
  a.wave.shadows = {layout.take<Ray>(num_slots), layout.take<uint32_t>(num_slots),
                    layout.take<Vec3f>(num_slots)};
  a.wave.shadow_queue = {layout.take<Ray>(queue), layout.take<uint32_t>(queue), layout.take<Vec3f>(queue)};
  a.wave.occluded = layout.take<uint8_t>(queue);
  a.block_counts = layout.take<uint32_t>(compact_num_blocks(uint32_t(n)));
  a.largest = layout.take<uint32_t>(1);
  const uint64_t num_placed = schedule.compaction == Compaction::BlockScan ? 0 : n;
  for (int set = 0; set < 2; ++set) {
    a.flags[set] = layout.take<uint32_t>(set == 0 || counted ? num_placed : 0);
    a.places[set] = layout.take<uint32_t>(set == 0 || counted ? num_placed : 0);
  }
  a.placement_bytes = placement_bytes(schedule.compaction, uint32_t(num_placed));
  a.placement_memory = layout.take<std::byte>(a.placement_bytes);
  a.sort_bytes = schedule.shading == Shading::Sorted ? sort_hits_bytes(uint32_t(n)) : 0;
  a.sort_memory = layout.take<std::byte>(a.sort_bytes);
  a.uber_numbers = layout.take<unsigned long long>(num_uber_numbers);
  a.trace_scratch = layout.take<uint32_t>(trace_scratch_words(n));
  a.bytes = layout.bytes();
  return a;
}

}  // namespace

uint64_t WaveMemory::bytes_for(uint32_t capacity, const Schedule &schedule)
{
  return lay_out(nullptr, capacity, schedule).bytes;
}

uint64_t WaveMemory::ray_budget() const
{
  return schedule_.ray_budget != 0 ? schedule_.ray_budget : uint64_t(capacity_) * 2;
}

WaveMemory::WaveMemory(const std::shared_ptr<DeviceMemory> &memory, uint32_t capacity,
                       const Schedule &schedule, cudaStream_t stream)
    : capacity_(capacity),
      schedule_(schedule),
      buffer_(memory, bytes_for(capacity, schedule), "a wave of paths"),
      pinned_numbers_(pinned_.reserve(256))
{
  const WaveArrays arrays = lay_out(buffer_.data(), capacity, schedule);
  wave_ = arrays.wave;
  block_counts_ = arrays.block_counts;
  largest_ = arrays.largest;
  for (int set = 0; set < 2; ++set) {
    flags_[set] = arrays.flags[set];
    places_[set] = arrays.places[set];
  }
  placement_memory_ = arrays.placement_memory;
  placement_bytes_ = arrays.placement_bytes;
  sort_memory_ = arrays.sort_memory;
  sort_bytes_ = arrays.sort_bytes;
  uber_numbers_ = arrays.uber_numbers;
  // The uber-kernel of paths traces for itself.
  if (!is_fused(schedule) && schedule.traversal != Traversal::Uber)
    tracer_.emplace(schedule, memory, capacity, stream);
  trace_scratch_ = arrays.trace_scratch;
}

CompactScratch WaveMemory::compaction() const { return {block_counts_, host_numbers()}; }

}  // namespace gpurt::cuda
