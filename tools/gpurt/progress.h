// What a person sees while work goes on: a bar on a terminal, a line now and then elsewhere.
#pragma once

#include <chrono>
#include <string>

namespace cli {

class Progress {
 public:
  Progress(std::string what, bool quiet);
  ~Progress();
  /// share in [0, 1].
  void update(double share);

 private:
  double seconds() const;

  std::string what_;
  bool is_quiet_, is_terminal_, has_bar_ = false;
  double next_share_ = 0.1, next_seconds_ = 5;  // of plain lines
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// "12.3 s", "4 min 05 s", "2 h 10 min".
std::string format_seconds(double seconds);

/// Ctrl-C and SIGTERM while this lives only set a flag; a second one ends the program at once, as usual.
class InterruptGuard {
 public:
  InterruptGuard();
  ~InterruptGuard();
  InterruptGuard(const InterruptGuard &) = delete;
  InterruptGuard &operator=(const InterruptGuard &) = delete;
  static bool interrupted();
};

}  // namespace cli
