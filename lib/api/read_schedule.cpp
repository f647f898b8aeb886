#include "api/read_schedule.h"

#include "api/descriptor.h"
#include "schedule_desc.h"

namespace gpurt::api {

Schedule checked_schedule(const gpurt_schedule &d)
{
  check_enum(d.traversal, GPURT_TRAVERSAL_UBER + 1, "schedule.traversal", "gpurt_traversal");
  check_enum(d.launch, GPURT_LAUNCH_ROUNDS + 1, "schedule.launch", "gpurt_launch");
  check_enum(d.fetch, GPURT_FETCH_PACKETS + 1, "schedule.fetch", "gpurt_fetch");
  check_enum(d.compaction, GPURT_COMPACTION_LIBRARY_SCAN + 1, "schedule.compaction", "gpurt_compaction");
  check_enum(d.shading, GPURT_SHADING_SORTED + 1, "schedule.shading", "gpurt_shading");
  check_enum(d.generation, GPURT_GENERATION_REFILLED + 1, "schedule.generation", "gpurt_generation");
  check_reserved(d.reserved[0], "schedule.reserved[0]");
  check_reserved(d.reserved[1], "schedule.reserved[1]");
  if (d.ray_budget == 1) {
    fail_invalid(
        "schedule.ray_budget is 1, but a hit makes up to two rays; give 2 or more, or 0 for what memory "
        "holds");
  }
  return schedule_from(d);
}

}  // namespace gpurt::api
