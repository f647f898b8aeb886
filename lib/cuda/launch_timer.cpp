#include "cuda/launch_timer.h"

#include <algorithm>
#include <atomic>
#include <deque>
#include <memory>
#include <mutex>
#include <vector>

#include "cuda/lanes.h"

namespace gpurt::cuda {

struct TimedLaunch::Times {
  Event begin, end;
  std::string name;
};

namespace {

using LaunchTimes = TimedLaunch::Times;

// Launches whose times are not read yet, of all threads.
struct Timing {
  std::atomic<bool> is_on{false};
  std::mutex mutex;
  std::deque<std::unique_ptr<LaunchTimes>> running;
  std::vector<std::unique_ptr<LaunchTimes>> idle;
  std::map<std::string, double> longest;
};

Timing &timing()
{
  static auto *const all = new Timing;  // its events go with the timer, not with the process
  return *all;
}

// Of the launches that began first; the mutex is held.
void read_finished(Timing &all, bool waits)
{
  while (!all.running.empty()) {
    LaunchTimes &times = *all.running.front();
    if (waits) times.end.wait();
    const cudaError_t status = cudaEventQuery(times.end.get());
    if (status == cudaErrorNotReady) {
      (void)cudaGetLastError();
      return;
    }
    check(status, "cudaEventQuery");
    double &longest = all.longest[times.name];
    longest = std::max(longest, seconds_between(times.begin, times.end));
    all.idle.push_back(std::move(all.running.front()));
    all.running.pop_front();
  }
}

}  // namespace

LaunchTimer::LaunchTimer() { timing().is_on = true; }

LaunchTimer::~LaunchTimer()
{
  Timing &all = timing();
  all.is_on = false;
  const std::lock_guard lock(all.mutex);
  all.running.clear();
  all.idle.clear();
  all.longest.clear();
}

std::map<std::string, double> LaunchTimer::longest()
{
  Timing &all = timing();
  const std::lock_guard lock(all.mutex);
  read_finished(all, true);
  return all.longest;
}

TimedLaunch::TimedLaunch(cudaStream_t stream) : stream_(stream), times_(nullptr)
{
  Timing &all = timing();
  if (!all.is_on.load(std::memory_order_relaxed)) return;
  std::unique_ptr<LaunchTimes> times;
  {
    const std::lock_guard lock(all.mutex);
    read_finished(all, false);
    if (!all.idle.empty()) {
      times = std::move(all.idle.back());
      all.idle.pop_back();
    }
  }
  if (!times) times = std::make_unique<LaunchTimes>();
  times->begin.record(stream);
  times_ = times.release();
}

TimedLaunch::~TimedLaunch() { delete times_; }

void TimedLaunch::end(const char *name)
{
  if (times_ == nullptr) return;
  std::unique_ptr<LaunchTimes> times(times_);
  times_ = nullptr;
  times->end.record(stream_);
  times->name = name;
  Timing &all = timing();
  const std::lock_guard lock(all.mutex);
  all.running.push_back(std::move(times));
}

}  // namespace gpurt::cuda
