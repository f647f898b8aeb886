// Work that several devices draw from one queue: in large parts at first, so that each part fills a device, then in
// smaller ones, so that all devices are done at about the same time whatever their speed.
#pragma once

#include <algorithm>
#include <cstdint>
#include <mutex>
#include <span>
#include <vector>

namespace gpurt::multi {

/// The size of the next part: half of what would be every worker's share of the rest.
inline uint64_t part_size(uint64_t rest, uint64_t num_workers, uint64_t smallest)
{
  return std::max(rest / (2 * num_workers), smallest);
}

/// A range of indices to be handed out. Used from any thread.
class SharedRange {
 public:
  SharedRange(uint64_t count, uint64_t num_workers, uint64_t smallest)
      : count_(count), num_workers_(num_workers), smallest_(smallest)
  {}
  /// False: nothing is left.
  bool take(uint64_t &first, uint64_t &count)
  {
    const std::lock_guard lock(mutex_);
    if (next_ == count_) return false;
    first = next_;
    count = std::min(part_size(count_ - next_, num_workers_, smallest_), count_ - next_);
    next_ += count;
    return true;
  }

 private:
  const uint64_t count_, num_workers_, smallest_;
  std::mutex mutex_;
  uint64_t next_ = 0;
};

/// The units of a pass, for some workers of each of the members. Used from any thread.
class SharedUnits {
 public:
  SharedUnits(std::span<const WorkUnit> units, size_t num_members, size_t workers_per_member,
              uint64_t smallest)
      : units_(units),
        num_workers_(num_members * workers_per_member),
        smallest_(smallest),
        num_active_(num_members, workers_per_member)
  {
    for (const WorkUnit &u : units) rest_ += num_paths(u);
  }

  /// Neighbouring units; none: a worker of the member has ended.
  std::span<const WorkUnit> take(size_t member)
  {
    const std::lock_guard lock(mutex_);
    const std::span<const WorkUnit> part = next_part();
    if (part.empty()) --num_active_[member];
    return part;
  }

  /// The same for a worker that has not ended when there are none: it asks take() once more.
  std::span<const WorkUnit> take_more()
  {
    const std::lock_guard lock(mutex_);
    return next_part();
  }

  /// Leaves the part to others: a worker of the member has ended. False where it is the member's last: then nothing
  /// happens.
  bool give_back(size_t member, std::span<const WorkUnit> part)
  {
    const std::lock_guard lock(mutex_);
    if (num_active_[member] <= 1) return false;
    --num_active_[member];
    returned_.push_back(part);
    return true;
  }

 private:
  std::span<const WorkUnit> next_part()
  {
    if (!returned_.empty()) {
      const std::span<const WorkUnit> part = returned_.back();
      returned_.pop_back();
      return part;
    }
    const uint64_t wanted = part_size(rest_, num_workers_, smallest_);
    const size_t first = next_;
    for (uint64_t paths = 0; next_ < units_.size() && paths < wanted; ++next_) {
      paths += num_paths(units_[next_]);
      rest_ -= num_paths(units_[next_]);
    }
    return units_.subspan(first, next_ - first);
  }

  static uint64_t num_paths(const WorkUnit &u)
  {
    return uint64_t(u.x1 - u.x0) * (u.y1 - u.y0) * u.num_samples;
  }

  const std::span<const WorkUnit> units_;
  const uint64_t num_workers_, smallest_;
  std::mutex mutex_;
  size_t next_ = 0;
  uint64_t rest_ = 0;
  std::vector<size_t> num_active_;
  std::vector<std::span<const WorkUnit>> returned_;
};

}  // namespace gpurt::multi
