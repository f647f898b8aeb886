#include "cuda/lanes.h"

#include <atomic>
#include <exception>
#include <new>
#include <thread>

namespace gpurt::cuda {

namespace {

// Small buffers come and go with every pass, and giving page-locked memory back waits for all that runs on the device:
// they are kept for the next one. The last of them go with the process.
constexpr uint64_t small_bytes = 4096;

struct SmallBlocks {
  std::mutex mutex;
  std::vector<void *> idle;
};

SmallBlocks &small_blocks()
{
  static auto *const blocks = new SmallBlocks;
  return *blocks;
}

void *take_small_block()
{
  {
    SmallBlocks &blocks = small_blocks();
    const std::lock_guard lock(blocks.mutex);
    if (!blocks.idle.empty()) {
      void *data = blocks.idle.back();
      blocks.idle.pop_back();
      return data;
    }
  }
  void *data = nullptr;
  check(cudaHostAlloc(&data, small_bytes, cudaHostAllocPortable), "cudaHostAlloc");  // for every device
  return data;
}

void free_pinned(void *data, uint64_t bytes) noexcept
{
  if (data == nullptr) return;
  if (bytes == small_bytes) {
    try {
      SmallBlocks &blocks = small_blocks();
      const std::lock_guard lock(blocks.mutex);
      blocks.idle.push_back(data);
      return;
    } catch (const std::bad_alloc &) {
      // No room to keep it: it goes.
    }
  }
  ignore(cudaFreeHost(data));
}

}  // namespace

PinnedBuffer::~PinnedBuffer() { free_pinned(data_, bytes_); }

void *PinnedBuffer::reserve(uint64_t bytes)
{
  if (bytes <= bytes_) return data_;
  void *data = nullptr;
  if (bytes <= small_bytes) {
    data = take_small_block();
    bytes = small_bytes;
  } else {
    check(cudaMallocHost(&data, bytes), "cudaMallocHost");
  }
  free_pinned(data_, bytes_);
  data_ = data;
  bytes_ = bytes;
  return data_;
}

double seconds_between(const Event &begin, const Event &end)
{
  float milliseconds = 0;
  check(cudaEventElapsedTime(&milliseconds, begin.get(), end.get()), "cudaEventElapsedTime");
  return milliseconds * 1e-3;
}

void Lane::wait_for_default_stream()
{
  order_.record(cudaStreamLegacy);
  check(cudaStreamWaitEvent(stream(), order_.get(), 0), "cudaStreamWaitEvent");
}

LaneLease::~LaneLease()
{
  ignore(cudaStreamSynchronize(lane_->stream()));
  try {
    const std::lock_guard lock(pool_.mutex_);
    pool_.idle_.push_back(std::move(lane_));
  } catch (const std::bad_alloc &) {
    // No room to keep it: the lane goes.
  }
}

LaneLease LanePool::acquire()
{
  {
    const std::lock_guard lock(mutex_);
    if (!idle_.empty()) {
      std::unique_ptr<Lane> lane = std::move(idle_.back());
      idle_.pop_back();
      return LaneLease(*this, std::move(lane));
    }
  }
  return LaneLease(*this, std::make_unique<Lane>());
}

void run_on_lanes(LanePool &pool, int ordinal, unsigned num_lanes,
                  const std::function<void(Lane &lane, const std::atomic<bool> &stop)> &work)
{
  std::atomic<bool> stop{false};
  std::mutex mutex;
  std::exception_ptr first_error;
  const auto run = [&] {
    try {
      const DeviceScope scope(ordinal);
      const LaneLease lane = pool.acquire();
      work(*lane, stop);
    } catch (...) {
      stop = true;
      const std::lock_guard lock(mutex);
      if (!first_error) first_error = std::current_exception();
    }
  };
  std::vector<std::thread> threads;
  threads.reserve(num_lanes);
  try {
    for (unsigned i = 1; i < num_lanes; ++i) threads.emplace_back(run);
  } catch (const std::exception &) {
    // No thread, or no memory for one: fewer do the same work.
  }
  run();
  for (std::thread &thread : threads) thread.join();
  if (first_error) std::rethrow_exception(first_error);
}

}  // namespace gpurt::cuda
