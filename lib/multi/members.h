// The devices that work as one, and how something is done on all of them.
#pragma once

#include <functional>

#include "backend.h"

namespace gpurt::multi {

/// Shared by the backend and its scenes.
struct Members {
  std::vector<std::unique_ptr<Backend>> backends;

  size_t size() const { return backends.size(); }
  /// "CUDA device 1".
  std::string name(size_t member) const;
  /// All of them, for messages: "0 and 1".
  std::string ordinals() const;
  /// The member whose memory `data` is; throws INVALID_ARGUMENT naming the argument where it is nobody's.
  size_t holder(const void *data, const char *argument) const;
  /// The member with this ordinal; throws INVALID_ARGUMENT.
  size_t with_ordinal(uint32_t ordinal) const;
};

/// Calls work(member) and puts the member's name before the text of an error.
void run_named(const Members &members, size_t member, const std::function<void()> &work);

/// Calls work(i) for i < n on a thread each, the caller's among them. Once all have ended, the first error in the order of
/// i is thrown again.
void run_side_by_side(size_t n, const std::function<void(size_t i)> &work);

}  // namespace gpurt::multi
