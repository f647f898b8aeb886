#include "cuda/path/wave.h"

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

// Lays arrays out one behind the other, each where 16-byte loads and full memory transactions begin.
class Layout {
 public:
  explicit Layout(std::byte *base) : base_(base) {}
  template <class T>
  T *take(uint64_t count)
  {
    T *p = base_ == nullptr ? nullptr : reinterpret_cast<T *>(base_ + bytes_);
    bytes_ += (count * sizeof(T) + 255) / 256 * 256;
    return p;
  }
  uint64_t bytes() const { return bytes_; }

 private:
  std::byte *base_;
  uint64_t bytes_ = 0;
};

struct WaveArrays {
  PathWave wave;
  uint32_t *block_counts, *largest;
  uint64_t bytes;
};

WaveArrays lay_out(std::byte *base, uint64_t n)
{
  Layout layout(base);
  WaveArrays a;
  a.wave.paths = layout.take<PathState>(n);
  a.wave.rays = {layout.take<Ray>(n), layout.take<uint32_t>(n)};
  a.wave.hits = layout.take<Hit>(n);
  a.wave.next_rays = {layout.take<Ray>(n), layout.take<uint32_t>(n)};
  a.wave.shadows = {layout.take<Ray>(n), layout.take<uint32_t>(n), layout.take<Vec3f>(n)};
  a.wave.shadow_queue = {layout.take<Ray>(n), layout.take<uint32_t>(n), layout.take<Vec3f>(n)};
  a.wave.occluded = layout.take<uint8_t>(n);
  a.block_counts = layout.take<uint32_t>(compact_num_blocks(uint32_t(n)));
  a.largest = layout.take<uint32_t>(1);
  a.bytes = layout.bytes();
  return a;
}

}  // namespace

uint64_t WaveMemory::bytes_for(uint32_t capacity) { return lay_out(nullptr, capacity).bytes; }

WaveMemory::WaveMemory(const std::shared_ptr<DeviceMemory> &memory, uint32_t capacity)
    : capacity_(capacity),
      buffer_(memory, bytes_for(capacity), "a wave of paths"),
      pinned_numbers_(pinned_.reserve(256))
{
  const WaveArrays arrays = lay_out(buffer_.data(), capacity);
  wave_ = arrays.wave;
  block_counts_ = arrays.block_counts;
  largest_ = arrays.largest;
}

CompactScratch WaveMemory::compaction() const { return {block_counts_, host_numbers()}; }

}  // namespace gpurt::cuda
