#include "schedule.h"

#include "error.h"

namespace gpurt {
namespace {

template <class E>
void expect_plain(E asked, E plain, const char *field, const char *plain_name, const char *device)
{
  if (asked == E::Auto || asked == plain) return;
  fail(GPURT_ERROR_UNSUPPORTED,
       "schedule.{} is {}, which schedules kernels of CUDA devices; {} has {} alone: use that, or leave it "
       "AUTO",
       field, uint32_t(asked), device, plain_name);
}

}  // namespace

Schedule resolve_fused_schedule(const Schedule &asked, const char *device)
{
  expect_plain(asked.traversal, Traversal::Stack, "traversal", "GPURT_TRAVERSAL_STACK", device);
  expect_plain(asked.launch, Launch::Regular, "launch", "GPURT_LAUNCH_REGULAR", device);
  expect_plain(asked.fetch, Fetch::PerThread, "fetch", "GPURT_FETCH_PER_THREAD", device);
  expect_plain(asked.compaction, Compaction::BlockScan, "compaction", "GPURT_COMPACTION_BLOCK_SCAN", device);
  expect_plain(asked.shading, Shading::Immediate, "shading", "GPURT_SHADING_IMMEDIATE", device);
  expect_plain(asked.generation, Generation::Slots, "generation", "GPURT_GENERATION_SLOTS", device);
  if (asked.ray_budget != 0) {
    fail(GPURT_ERROR_UNSUPPORTED,
         "schedule.ray_budget is {}, but it bounds GPURT_GENERATION_COUNTED, which {} does not have; set it "
         "to 0",
         asked.ray_budget, device);
  }
  return {Traversal::Stack,
          Launch::Regular,
          Fetch::PerThread,
          Compaction::BlockScan,
          Shading::Immediate,
          Generation::Slots,
          0};
}

Schedule rays_of_reyes(Schedule asked, const char *pipeline)
{
  if (asked.generation != Generation::Auto && asked.generation != Generation::Slots) {
    fail(GPURT_ERROR_UNSUPPORTED,
         "schedule.generation is not GPURT_GENERATION_SLOTS, and {} has no other; leave it AUTO", pipeline);
  }
  asked.generation = Generation::Slots;
  asked.launch = Launch::Auto;
  asked.traversal = Traversal::Auto;
  return asked;
}

}  // namespace gpurt
