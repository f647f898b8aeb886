#include "cuda/lanes.h"

#include <atomic>
#include <exception>
#include <new>
#include <thread>

namespace gpurt::cuda {

PinnedBuffer::~PinnedBuffer()
{
  if (data_ != nullptr) ignore(cudaFreeHost(data_));
}

void *PinnedBuffer::reserve(uint64_t bytes)
{
  if (bytes <= bytes_) return data_;
  void *data = nullptr;
  check(cudaMallocHost(&data, bytes), "cudaMallocHost");
  if (data_ != nullptr) ignore(cudaFreeHost(data_));
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
