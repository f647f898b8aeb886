// How a CUDA device goes about its work: the values of gpurt_schedule, and what is counted on the way.
#pragma once

#include <cstdint>

namespace gpurt {

enum class Traversal : uint32_t { Auto = 0, Stack = 1, LeafLists = 2, Uber = 3 };
enum class Launch : uint32_t { Auto = 0, Regular = 1, Persistent = 2, Rounds = 3 };
enum class Fetch : uint32_t { Auto = 0, PerThread = 1, Packets = 2 };
enum class Compaction : uint32_t { Auto = 0, BlockScan = 1, Pyramid = 2, NaiveScan = 3, LibraryScan = 4 };
enum class Shading : uint32_t { Auto = 0, Immediate = 1, Sorted = 2 };
enum class Generation : uint32_t { Auto = 0, Slots = 1, Counted = 2, Refilled = 3 };

/// gpurt_schedule after validation.
struct Schedule {
  Traversal traversal = Traversal::Auto;
  Launch launch = Launch::Auto;
  Fetch fetch = Fetch::Auto;
  Compaction compaction = Compaction::Auto;
  Shading shading = Shading::Auto;
  Generation generation = Generation::Auto;
  uint64_t ray_budget = 0;
};

/// What gpurt_schedule says of REYES' own stages.
struct ReyesSchedule {
  Launch split = Launch::Auto;
  Traversal stages = Traversal::Auto;
  Compaction places = Compaction::Auto;  // of what levels of cutting write to their queue; Auto: it is pushed
};

/// Puts `value` for Auto.
template <class E>
void set_default(E &choice, E value)
{
  if (choice == E::Auto) choice = value;
}

/// gpurt_schedule_counters, without what is reserved.
struct ScheduleCounters {
  uint64_t ray_refills = 0, list_rounds = 0, list_overflows = 0, mode_switches = 0, packets = 0,
           shared_triangles = 0, compactions = 0, sorted_hits = 0, counted_rays = 0, wave_splits = 0,
           device_ns = 0, path_refills = 0, warp_steps = 0, lane_steps = 0;

  void add(const ScheduleCounters &other)
  {
    ray_refills += other.ray_refills;
    list_rounds += other.list_rounds;
    list_overflows += other.list_overflows;
    mode_switches += other.mode_switches;
    packets += other.packets;
    shared_triangles += other.shared_triangles;
    compactions += other.compactions;
    sorted_hits += other.sorted_hits;
    counted_rays += other.counted_rays;
    wave_splits += other.wave_splits;
    device_ns += other.device_ns;
    path_refills += other.path_refills;
    warp_steps += other.warp_steps;
    lane_steps += other.lane_steps;
  }
};

/// What a schedule is for.
enum class ScheduleUse { Query, AllHitsQuery, StreamQuery, Render };

/// The schedule of a device that has no other: the fused traversal, a ray a thread, shading as rays lie. Throws
/// UNSUPPORTED naming the first choice that differs; `device` is what the text calls it.
Schedule resolve_fused_schedule(const Schedule &asked, const char *device);

/// The schedule of rays for a pipeline that finds itself what eye rays would, and shades it by a path tracer's stages: rays
/// in slots, where the choice is the library's; `launch` and `traversal` name stages of its own, and are left to the
/// library for rays. Throws UNSUPPORTED where another generation was asked for.
Schedule rays_of_reyes(Schedule asked, const char *pipeline);

}  // namespace gpurt
