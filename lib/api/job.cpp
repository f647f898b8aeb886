// gpurt_job_*: forwards to lib/frame.
#include "frame/job.h"

#include "api/guard.h"
#include "api/objects.h"

using namespace gpurt;
using namespace gpurt::api;

gpurt_result gpurt_job_wait(gpurt_job job, uint64_t timeout_ns)
{
  return guard([&] { get(job, "job")->job->wait(timeout_ns); });
}

gpurt_result gpurt_job_cancel(gpurt_job job)
{
  return guard([&] { get(job, "job")->job->cancel(); });
}

gpurt_result gpurt_job_get_progress(gpurt_job job, double *out_share)
{
  return guard([&] {
    const auto object = get(job, "job");
    require(out_share, "out_share");
    *out_share = object->job->progress();
  });
}

gpurt_result gpurt_job_retain(gpurt_job job)
{
  return guard([&] { retain(job, "job"); });
}

gpurt_result gpurt_job_release(gpurt_job job)
{
  return guard([&] {
    // A thread that waits keeps the object alive, so its end alone would not cancel the job.
    if (const auto object = release(job, "job")) object->job->cancel();
  });
}
