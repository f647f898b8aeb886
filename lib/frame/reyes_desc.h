// gpurt_reyes_settings and gpurt_reyes_counters from and to the library's own types.
#pragma once

#include <fmt/format.h>

#include "backend.h"
#include "gpurt.h"

namespace gpurt {

inline bool operator==(const ReyesSettings &a, const ReyesSettings &b)
{
  return a.shading_rate == b.shading_rate && a.filter == b.filter && a.shading == b.shading &&
         a.no_shadows == b.no_shadows && a.flatness == b.flatness && a.fragment_slots == b.fragment_slots;
}

inline gpurt_reyes_settings public_settings(const ReyesSettings &s)
{
  return {
      s.shading_rate,  gpurt_reyes_filter(s.filter), gpurt_reyes_shading(s.shading), s.no_shadows, s.flatness,
      s.fragment_slots};
}

/// For error texts; "another pipeline" where they are all zero.
inline std::string describe(const ReyesSettings &s)
{
  if (s.shading_rate == 0) return "another pipeline";
  static constexpr const char *filters[] = {"auto", "box", "gaussian", "mitchell"};
  static constexpr const char *shadings[] = {"auto", "samples", "micropolygons", "blocks"};
  const std::string slots =
      s.fragment_slots != 0 ? fmt::format(" and {} slots of fragments", s.fragment_slots) : "";
  return fmt::format("reyes with shading rate {}, flatness {}, filter {}, shading of {}{}, {} shadows",
                     s.shading_rate, s.flatness, filters[uint32_t(s.filter) & 3],
                     shadings[uint32_t(s.shading) & 3], slots, s.no_shadows ? "no" : "with");
}

inline gpurt_reyes_counters public_counters(const ReyesCounters &c)
{
  gpurt_reyes_counters d = GPURT_REYES_COUNTERS_INIT;
  d.num_patches = c.num_patches;
  d.num_triangles = c.num_triangles;
  d.num_splits = c.num_splits;
  d.num_culled = c.num_culled;
  d.num_grids = c.num_grids;
  d.num_micropolygons = c.num_micropolygons;
  d.num_fragments = c.num_fragments;
  d.num_shaded = c.num_shaded;
  d.largest_queue = c.largest_queue;
  d.largest_bucket = c.largest_bucket;
  d.working_bytes = c.working_bytes;
  d.bound_seconds = c.bound_seconds;
  d.split_seconds = c.split_seconds;
  d.dice_seconds = c.dice_seconds;
  d.sample_seconds = c.sample_seconds;
  d.split_rounds = c.split_rounds;
  d.num_donated = c.num_donated;
  d.largest_fragments = c.largest_fragments;
  d.num_lost_fragments = c.num_lost_fragments;
  return d;
}

}  // namespace gpurt
