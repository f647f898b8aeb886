// gpurt_schedule and gpurt_schedule_counters from and to the library's own types.
#pragma once

#include "gpurt.h"
#include "schedule.h"

namespace gpurt {

/// Of a descriptor whose enums are known to hold values of theirs.
inline Schedule schedule_from(const gpurt_schedule &d)
{
  return {Traversal(d.traversal), Launch(d.launch),         Fetch(d.fetch), Compaction(d.compaction),
          Shading(d.shading),     Generation(d.generation), d.ray_budget};
}

inline gpurt_schedule describe(const Schedule &s)
{
  return {gpurt_traversal(s.traversal),
          gpurt_launch(s.launch),
          gpurt_fetch(s.fetch),
          gpurt_compaction(s.compaction),
          gpurt_shading(s.shading),
          gpurt_generation(s.generation),
          {0, 0},
          s.ray_budget};
}

inline gpurt_schedule_counters describe(const ScheduleCounters &c)
{
  gpurt_schedule_counters d = GPURT_SCHEDULE_COUNTERS_INIT;
  d.ray_refills = c.ray_refills;
  d.list_rounds = c.list_rounds;
  d.list_overflows = c.list_overflows;
  d.mode_switches = c.mode_switches;
  d.packets = c.packets;
  d.shared_triangles = c.shared_triangles;
  d.compactions = c.compactions;
  d.sorted_hits = c.sorted_hits;
  d.counted_rays = c.counted_rays;
  d.wave_splits = c.wave_splits;
  d.path_refills = c.path_refills;
  d.device_ns = c.device_ns;
  d.warp_steps = c.warp_steps;
  d.lane_steps = c.lane_steps;
  return d;
}

}  // namespace gpurt
