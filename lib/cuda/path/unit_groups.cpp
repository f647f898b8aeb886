#include "cuda/path/unit_groups.h"

#include <algorithm>
#include <tuple>

namespace gpurt::cuda {
namespace {

bool have_same_samples(const WorkUnit &a, const WorkUnit &b)
{
  return a.first_sample == b.first_sample && a.num_samples == b.num_samples;
}

uint64_t num_pixels(const WorkUnit &u) { return uint64_t(u.x1 - u.x0) * (u.y1 - u.y0); }

// Takes the right or lower neighbour in; false where the two form no rectangle or a too large one.
bool join(WorkUnit &a, const WorkUnit &b, bool to_the_right, uint64_t max_paths, uint64_t max_pixels)
{
  const bool touches = to_the_right ? a.x1 == b.x0 && a.y0 == b.y0 && a.y1 == b.y1
                                    : a.y1 == b.y0 && a.x0 == b.x0 && a.x1 == b.x1;
  if (!touches || !have_same_samples(a, b)) return false;
  const uint64_t pixels = num_pixels(a) + num_pixels(b);
  if (pixels > max_pixels || pixels * a.num_samples > max_paths) return false;
  a.x1 = b.x1;
  a.y1 = b.y1;
  return true;
}

// Units first .. last - 1 of a list, which lie side by side.
struct Row {
  WorkUnit bounds;
  size_t first, last;
};

template <class T, class Key>
void sort_by(std::vector<T> &values, Key &&key)
{
  const auto is_less = [&](const T &a, const T &b) { return key(a) < key(b); };
  if (!std::is_sorted(values.begin(), values.end(), is_less))
    std::sort(values.begin(), values.end(), is_less);
}

}  // namespace

std::vector<UnitGroup> group_units(std::span<const WorkUnit> units, uint64_t max_paths, uint64_t max_pixels)
{
  // Neighbours in a row of units first, then rows below one another.
  std::vector<WorkUnit> sorted(units.begin(), units.end());
  sort_by(sorted,
          [](const WorkUnit &u) { return std::tie(u.first_sample, u.num_samples, u.y0, u.y1, u.x0); });
  std::vector<Row> rows;
  for (size_t i = 0; i < sorted.size(); ++i) {
    if (!rows.empty() && join(rows.back().bounds, sorted[i], true, max_paths, max_pixels)) rows.back().last++;
    else rows.push_back({sorted[i], i, i + 1});
  }
  sort_by(rows, [](const Row &r) {
    const WorkUnit &u = r.bounds;
    return std::tie(u.first_sample, u.num_samples, u.x0, u.x1, u.y0);
  });
  std::vector<UnitGroup> groups;
  for (const Row &row : rows) {
    if (groups.empty() || !join(groups.back().bounds, row.bounds, false, max_paths, max_pixels))
      groups.push_back({row.bounds, {}});
    std::vector<WorkUnit> &to = groups.back().units;
    to.insert(to.end(), sorted.begin() + ptrdiff_t(row.first), sorted.begin() + ptrdiff_t(row.last));
  }
  return groups;
}

}  // namespace gpurt::cuda
