// Which schedules there are, and what AUTO is: what measured best on an H100 (docs/schedules.md).
#include "cuda/accel/near.h"
#include "cuda/accel/schedule/tracer.h"
#include "error.h"

namespace gpurt::cuda {
namespace {

template <class... Args>
[[noreturn]] void refuse(fmt::format_string<Args...> format, Args &&...args)
{
  fail(GPURT_ERROR_UNSUPPORTED, "schedule: {}", fmt::format(format, std::forward<Args>(args)...));
}

// The first way through the tree that is not the fused kernels'; null if there is none.
const char *special_choice(const Schedule &s)
{
  if (s.traversal == Traversal::LeafLists) return "GPURT_TRAVERSAL_LEAF_LISTS";
  if (s.traversal == Traversal::Uber) return "GPURT_TRAVERSAL_UBER";
  if (s.fetch == Fetch::Packets) return "GPURT_FETCH_PACKETS";
  if (s.launch == Launch::Persistent) return "GPURT_LAUNCH_PERSISTENT";
  return nullptr;
}

void check_traversal(const Schedule &s, ScheduleUse use, const TraceScene &scene)
{
  const char *special = special_choice(s);
  if (special == nullptr) return;
  if (use == ScheduleUse::AllHitsQuery) {
    refuse("{} does not exist for GPURT_QUERY_ALL, whose kernels have one schedule; leave it AUTO", special);
  }
  if (use == ScheduleUse::StreamQuery) {
    refuse("{} needs memory that work on a stream cannot wait for; use gpurt_scene_trace, or leave it AUTO",
           special);
  }
  // Of bvhs, persistent threads with a stack serve any scene and triangle test.
  const bool is_persistent_stack = s.traversal == Traversal::Stack && s.fetch == Fetch::PerThread;
  if (scene.has_bvhs && is_persistent_stack) return;
  if (scene.triangle_test != TriangleTest::Watertight) {
    refuse("{} exists for GPURT_TRIANGLE_WATERTIGHT alone; commit with it, or leave the schedule AUTO",
           special);
  }
  if (s.fetch == Fetch::Packets && s.traversal != Traversal::Stack) {
    refuse(
        "{} and GPURT_FETCH_PACKETS do not go together: a packet traverses with one stack; use "
        "GPURT_TRAVERSAL_STACK",
        special);
  }
  const bool is_uber_render = use == ScheduleUse::Render && s.traversal == Traversal::Uber;
  if (scene.has_bvhs && !is_uber_render) {
    refuse("{} exists for kd-trees alone; commit with GPURT_ACCEL_KDTREE, or leave it AUTO", special);
  }
}

template <class E>
void check_render_only(E choice, E fallback, ScheduleUse use, const char *field)
{
  if (use == ScheduleUse::Render || choice == E::Auto || choice == fallback) return;
  refuse("{} is a choice of renders, and a query has no queue of hits; leave it AUTO", field);
}

template <class E>
void check_has_queues(E choice, E fallback, const char *field)
{
  if (choice == E::Auto || choice == fallback) return;
  refuse(
      "{} goes with GPURT_TRAVERSAL_STACK or GPURT_TRAVERSAL_LEAF_LISTS: under GPURT_TRAVERSAL_UBER a path "
      "does not leave its kernel, and there is no queue; leave it AUTO",
      field);
}

}  // namespace

Schedule resolve_schedule(const Schedule &asked, ScheduleUse use, const TraceScene &scene)
{
  if (asked.launch == Launch::Rounds) {
    refuse(
        "GPURT_LAUNCH_ROUNDS is how GPURT_PIPELINE_REYES cuts patches, and rays have none; leave launch "
        "AUTO");
  }
  check_render_only(asked.compaction, Compaction::BlockScan, use, "compaction");
  check_render_only(asked.shading, Shading::Immediate, use, "shading");
  check_render_only(asked.generation, Generation::Slots, use, "generation");
  Schedule s = asked;
  const bool shades_as_rays_lie = asked.shading == Shading::Auto || asked.shading == Shading::Immediate;
  set_default(s.traversal, Traversal::Stack);
  set_default(s.fetch, Fetch::PerThread);
  // Rays of paths go apart after the first step, paths end at different lengths, and a wave is large enough for a pool of rays.
  // A pool of paths knows the triangles that its rays leave, so that the fast kernels serve all of them: where these may choose
  // by the order of rays, they are faster.
  const bool has_pool_of_paths =
      asked.generation == Generation::Refilled ||
      (asked.generation == Generation::Auto && asked.compaction == Compaction::Auto && shades_as_rays_lie);
  const bool has_pool =
      s.traversal == Traversal::Uber ||
      (s.traversal == Traversal::Stack && s.fetch == Fetch::PerThread && !scene.has_bvhs &&
       scene.triangle_test == TriangleTest::Watertight && !(has_pool_of_paths && has_near_kernels(scene)));
  const bool suits_pool = use == ScheduleUse::Render && has_pool;
  // Queries leave it to what is known of their rays' order, or found out.
  const bool is_by_order = use != ScheduleUse::Render && s.traversal == Traversal::Stack &&
                           s.fetch == Fetch::PerThread && has_near_kernels(scene);
  if (!is_by_order) set_default(s.launch, suits_pool ? Launch::Persistent : Launch::Regular);
  check_traversal(s, use, scene);
  if (use == ScheduleUse::Render && s.traversal == Traversal::Uber) {
    check_has_queues(s.compaction, Compaction::BlockScan, "compaction");
    check_has_queues(s.shading, Shading::Immediate, "shading");
    check_has_queues(s.generation, Generation::Slots, "generation");
    set_default(s.generation, Generation::Slots);
  }
  if (s.generation == Generation::Counted) {
    if (s.shading == Shading::Sorted) {
      refuse(
          "GPURT_GENERATION_COUNTED and GPURT_SHADING_SORTED do not go together: hits are counted and shaded "
          "as "
          "they lie; use GPURT_SHADING_IMMEDIATE");
    }
    if (s.compaction == Compaction::BlockScan) {
      refuse(
          "GPURT_COMPACTION_BLOCK_SCAN moves rays that were made, and GPURT_GENERATION_COUNTED wants their "
          "places "
          "before; use another compaction, or leave it AUTO");
    }
    set_default(s.compaction, Compaction::LibraryScan);
  }
  // A pool has no gaps to close, and shades as rays lie.
  const bool is_plain =
      (s.compaction == Compaction::Auto || s.compaction == Compaction::BlockScan) && shades_as_rays_lie;
  if (s.generation == Generation::Refilled && !is_plain) {
    refuse(
        "GPURT_GENERATION_REFILLED has no queue to compact and shades hits as they lie; leave compaction and "
        "shading AUTO");
  }
  const bool suits_refill = use == ScheduleUse::Render && asked.compaction == Compaction::Auto && is_plain;
  set_default(s.generation, suits_refill ? Generation::Refilled : Generation::Slots);
  set_default(s.compaction, Compaction::BlockScan);
  set_default(s.shading, Shading::Immediate);
  if (s.ray_budget != 0 && s.generation != Generation::Counted) {
    refuse("ray_budget is {}, but it bounds GPURT_GENERATION_COUNTED alone; ask for that, or set it to 0",
           s.ray_budget);
  }
  return s;
}

}  // namespace gpurt::cuda
