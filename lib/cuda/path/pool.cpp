#include "cuda/path/pool.h"

#include <algorithm>

#include "cuda/layout.h"

namespace gpurt::cuda {
namespace {

// Paths of a unit for each one that the pool follows at a time: so many that starting and running out take little of it.
constexpr uint64_t unit_factor = 4;

uint32_t fitting_unit(uint32_t capacity, uint64_t max_unit_paths)
{
  return uint32_t(std::min<uint64_t>(max_unit_paths, unit_factor * capacity));
}

}  // namespace

struct PoolMemory::Arrays {
  PathQueue queues[2];
  Hit *hits;
  PoolShadows shadows;
  PathResult *results;
  uint32_t *trace_scratch, *numbers;
  uint64_t bytes;
};

PoolMemory::Arrays PoolMemory::lay_out(std::byte *base, uint64_t n, uint64_t unit_capacity)
{
  Layout layout(base);
  Arrays a;
  for (PathQueue &q : a.queues) q = {layout.take<PoolPath>(n), layout.take<Ray>(n), layout.take<uint32_t>(n)};
  a.hits = layout.take<Hit>(n);
  a.shadows.queue = {layout.take<Ray>(n), layout.take<uint32_t>(n), layout.take<Vec3f>(n)};
  a.shadows.left_out = layout.take<uint32_t>(n);
  a.shadows.ended_at = layout.take<uint32_t>(n);
  a.shadows.occluded = layout.take<uint8_t>(n);
  a.results = layout.take<PathResult>(unit_capacity);
  a.trace_scratch = layout.take<uint32_t>(trace_scratch_words(n));
  a.numbers = layout.take<uint32_t>(num_numbers);
  a.bytes = layout.bytes();
  return a;
}

PoolMemory::PoolMemory(const std::shared_ptr<DeviceMemory> &memory, uint32_t capacity,
                       uint64_t max_unit_paths, const Schedule &schedule, cudaStream_t stream)
    : capacity_(capacity),
      unit_capacity_(fitting_unit(capacity, max_unit_paths)),
      buffer_(memory, lay_out(nullptr, capacity_, unit_capacity_).bytes, "a pool of paths"),
      pinned_numbers_(pinned_.reserve(256))
{
  const Arrays a = lay_out(buffer_.data(), capacity_, unit_capacity_);
  queues_[0] = a.queues[0];
  queues_[1] = a.queues[1];
  hits_ = a.hits;
  shadows_ = a.shadows;
  results_ = a.results;
  trace_scratch_ = a.trace_scratch;
  numbers_ = a.numbers;
  if (!is_fused(schedule)) tracer_.emplace(schedule, memory, capacity, stream);
}

}  // namespace gpurt::cuda
