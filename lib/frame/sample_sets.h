// Which samples a pixel has: exact, so that merging can refuse to count one twice.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <vector>

namespace gpurt {

/// Sample indices begin .. end - 1.
struct SampleRange {
  uint64_t begin, end;
  auto operator<=>(const SampleRange &) const = default;
};

/// A table of sets of sample indices. Pixels with the same history share an entry, so that a frame holds four bytes a
/// pixel and a handful of entries. Not synchronised.
class SampleSets {
 public:
  static constexpr uint32_t empty = 0;

  SampleSets() { intern({}); }
  SampleSets(SampleSets &&) = default;
  SampleSets(const SampleSets &other)
  {
    for (const auto *ranges : other.sets_) intern(*ranges);
  }
  SampleSets &operator=(SampleSets &&) = default;

  /// Sorted, disjoint and not adjacent.
  std::span<const SampleRange> ranges(uint32_t set) const { return *sets_[set]; }
  size_t size() const { return sets_.size(); }
  uint64_t num_samples(uint32_t set) const;
  /// One past the last sample.
  uint64_t end(uint32_t set) const { return sets_[set]->empty() ? 0 : sets_[set]->back().end; }
  bool has_gaps(uint32_t set) const { return sets_[set]->size() > 1; }

  /// The entry for both sets together; invalid_id where they share a sample.
  uint32_t unite(uint32_t set, std::span<const SampleRange> other);

 private:
  uint32_t intern(std::vector<SampleRange> ranges);

  std::map<std::vector<SampleRange>, uint32_t> ids_;
  std::vector<const std::vector<SampleRange> *> sets_;  // keys of ids_, which stay where they are
};

}  // namespace gpurt
