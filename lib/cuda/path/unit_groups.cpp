#include "cuda/path/unit_groups.h"

#include <algorithm>
#include <tuple>

namespace gpurt::cuda {
namespace {

bool have_same_samples(const WorkUnit &a, const WorkUnit &b)
{
  return a.first_sample == b.first_sample && a.num_samples == b.num_samples;
}

// Appends the right or lower neighbour; false where the two form no rectangle or a too large one.
bool join(UnitGroup &group, const UnitGroup &next, bool to_the_right, uint64_t max_paths, uint64_t max_pixels)
{
  const WorkUnit &a = group.bounds, &b = next.bounds;
  const bool touches = to_the_right ? a.x1 == b.x0 && a.y0 == b.y0 && a.y1 == b.y1
                                    : a.y1 == b.y0 && a.x0 == b.x0 && a.x1 == b.x1;
  if (!touches || !have_same_samples(a, b)) return false;
  if (group.num_paths() + next.num_paths() > max_paths || group.num_pixels() + next.num_pixels() > max_pixels)
    return false;
  group.bounds.x1 = b.x1;
  group.bounds.y1 = b.y1;
  group.units.insert(group.units.end(), next.units.begin(), next.units.end());
  return true;
}

// Joins groups that follow one another in the list.
std::vector<UnitGroup> join_all(std::vector<UnitGroup> groups, bool to_the_right, uint64_t max_paths,
                                uint64_t max_pixels)
{
  std::vector<UnitGroup> joined;
  for (UnitGroup &g : groups) {
    if (joined.empty() || !join(joined.back(), g, to_the_right, max_paths, max_pixels))
      joined.push_back(std::move(g));
  }
  return joined;
}

}  // namespace

std::vector<UnitGroup> group_units(std::span<const WorkUnit> units, uint64_t max_paths, uint64_t max_pixels)
{
  std::vector<UnitGroup> groups;
  groups.reserve(units.size());
  for (const WorkUnit &unit : units) groups.push_back({unit, {unit}});
  // Neighbours in a row of units first, then rows below one another.
  std::sort(groups.begin(), groups.end(), [](const UnitGroup &a, const UnitGroup &b) {
    return std::tie(a.bounds.first_sample, a.bounds.num_samples, a.bounds.y0, a.bounds.y1, a.bounds.x0) <
           std::tie(b.bounds.first_sample, b.bounds.num_samples, b.bounds.y0, b.bounds.y1, b.bounds.x0);
  });
  groups = join_all(std::move(groups), true, max_paths, max_pixels);
  std::sort(groups.begin(), groups.end(), [](const UnitGroup &a, const UnitGroup &b) {
    return std::tie(a.bounds.first_sample, a.bounds.num_samples, a.bounds.x0, a.bounds.x1, a.bounds.y0) <
           std::tie(b.bounds.first_sample, b.bounds.num_samples, b.bounds.x0, b.bounds.x1, b.bounds.y0);
  });
  return join_all(std::move(groups), false, max_paths, max_pixels);
}

}  // namespace gpurt::cuda
