#include "frame/sample_sets.h"

#include <algorithm>

#include "core/platform.h"

namespace gpurt {

uint64_t SampleSets::num_samples(uint32_t set) const
{
  uint64_t n = 0;
  for (const SampleRange &r : ranges(set)) n += r.end - r.begin;
  return n;
}

uint32_t SampleSets::unite(uint32_t set, std::span<const SampleRange> other)
{
  std::vector<SampleRange> all(ranges(set).begin(), ranges(set).end());
  all.insert(all.end(), other.begin(), other.end());
  std::sort(all.begin(), all.end());
  std::vector<SampleRange> joined;
  for (const SampleRange &r : all) {
    if (!joined.empty() && r.begin < joined.back().end) return invalid_id;
    if (!joined.empty() && r.begin == joined.back().end) joined.back().end = r.end;
    else joined.push_back(r);
  }
  return intern(std::move(joined));
}

uint32_t SampleSets::intern(std::vector<SampleRange> ranges)
{
  const auto [entry, is_new] = ids_.try_emplace(std::move(ranges), uint32_t(sets_.size()));
  if (is_new) sets_.push_back(&entry->first);
  return entry->second;
}

}  // namespace gpurt
