#include "progress.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>

namespace cli {

namespace {

volatile std::sig_atomic_t interrupt_seen = 0;

void on_interrupt(int signal)
{
  interrupt_seen = 1;
  std::signal(signal, SIG_DFL);
}

}  // namespace

std::string format_seconds(double seconds)
{
  if (seconds < 99.95) return fmt::format("{:.1f} s", seconds);
  const long whole = long(seconds + 0.5);
  if (whole < 3600) return fmt::format("{} min {:02} s", whole / 60, whole % 60);
  return fmt::format("{} h {:02} min", whole / 3600, whole / 60 % 60);
}

Progress::Progress(std::string what, bool quiet)
    : what_(std::move(what)), is_quiet_(quiet), is_terminal_(::isatty(STDERR_FILENO) == 1)
{}

Progress::~Progress()
{
  if (has_bar_) fmt::print(stderr, "\r\x1b[K");
}

double Progress::seconds() const
{
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
}

void Progress::update(double share)
{
  if (is_quiet_) return;
  const double elapsed = seconds();
  if (!is_terminal_) {
    // Short work needs no lines in a log, and nothing needs many.
    if (elapsed < next_seconds_ || share < next_share_ || share >= 1) return;
    next_seconds_ = elapsed + 5;
    fmt::print(stderr, "{}: {:.0f} % after {}\n", what_, 100 * share, format_seconds(elapsed));
    next_share_ = (std::round(share * 10) + 1) / 10;
    return;
  }
  constexpr int width = 30;
  const int filled = std::clamp(int(share * width), 0, width);
  const std::string left = share > 0.02 && elapsed > 1
                               ? fmt::format(", about {} left", format_seconds(elapsed * (1 - share) / share))
                               : "";
  fmt::print(stderr, "\r{} [{:#<{}}{:.<{}}] {:3.0f} % {}{}\x1b[K", what_, "", filled, "", width - filled,
             100 * share, format_seconds(elapsed), left);
  std::fflush(stderr);
  has_bar_ = true;
}

InterruptGuard::InterruptGuard()
{
  interrupt_seen = 0;
  std::signal(SIGINT, on_interrupt);
  std::signal(SIGTERM, on_interrupt);
}

InterruptGuard::~InterruptGuard()
{
  std::signal(SIGINT, SIG_DFL);
  std::signal(SIGTERM, SIG_DFL);
}

bool InterruptGuard::interrupted() { return interrupt_seen != 0; }

}  // namespace cli
