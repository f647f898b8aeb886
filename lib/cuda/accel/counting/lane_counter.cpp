#include "cuda/accel/counting/lane_counter.h"

#include <array>

#include "cuda/accel/counting/kernels.h"
#include "cuda/check.h"

namespace gpurt::cuda {
namespace {

using Totals = std::array<LaneTotals, num_lane_totals>;

std::array<LaneTotals *, 2> all_totals()
{
  return {counting::totals_of_fused_kernels(), counting::totals_of_scheduled_kernels()};
}

std::mutex &counting_mutex()
{
  static std::mutex mutex;
  return mutex;
}

}  // namespace

LaneCounter::LaneCounter() : lock_(counting_mutex()) {}

void LaneCounter::clear(cudaStream_t stream) const
{
  for (LaneTotals *totals : all_totals())
    check(cudaMemsetAsync(totals, 0, sizeof(Totals), stream), "cudaMemsetAsync");
  check(cudaStreamSynchronize(stream), "cudaStreamSynchronize");
}

void LaneCounter::collect(ScheduleCounters &sum, cudaStream_t stream) const
{
  for (LaneTotals *totals : all_totals()) {
    Totals host{};
    check(cudaMemcpyAsync(&host, totals, sizeof host, cudaMemcpyDeviceToHost, stream), "cudaMemcpyAsync");
    check(cudaStreamSynchronize(stream), "cudaStreamSynchronize");
    for (const LaneTotals &t : host) {
      sum.warp_steps += t.warp_steps;
      sum.lane_steps += t.lane_steps;
    }
  }
}

}  // namespace gpurt::cuda
