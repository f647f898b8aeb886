// What the commands share: failures with exit codes, handles that release themselves, common options.
#pragma once

#include <fmt/core.h>
#include <CLI/CLI.hpp>

#include <cstdint>
#include <stdexcept>
#include <string>
#include <utility>

#include "gpurt.h"

namespace cli {

// Exit codes, as the documentation promises them.
constexpr int exit_ok = 0, exit_failure = 1, exit_usage = 2, exit_interrupted = 130;

/// One clear line for stderr and the exit code that goes with it.
class Failure : public std::runtime_error {
 public:
  explicit Failure(const std::string &text, int code = exit_failure) : std::runtime_error(text), code_(code)
  {}
  int code() const { return code_; }

 private:
  int code_;
};

template <class... Args>
[[noreturn]] void fail(fmt::format_string<Args...> format, Args &&...args)
{
  throw Failure(fmt::format(format, std::forward<Args>(args)...));
}

/// A mistake on the command line that the parser could not see.
template <class... Args>
[[noreturn]] void fail_usage(fmt::format_string<Args...> format, Args &&...args)
{
  throw Failure(fmt::format(format, std::forward<Args>(args)...), exit_usage);
}

/// The library's text with the names of its C interface replaced by those of the options that set them.
std::string in_options(std::string text);

/// Throws the library's own text unless the call went well.
inline void check(gpurt_result result)
{
  if (result != GPURT_OK) throw Failure(in_options(gpurt_last_error()));
}

template <class Handle, gpurt_result (*release)(Handle)>
class Owned {
 public:
  Owned() = default;
  Owned(Owned &&other) noexcept : handle_(std::exchange(other.handle_, nullptr)) {}
  Owned &operator=(Owned &&other) noexcept
  {
    std::swap(handle_, other.handle_);
    return *this;
  }
  ~Owned()
  {
    if (handle_) release(handle_);
  }
  operator Handle() const { return handle_; }
  Handle *out() { return &handle_; }

 private:
  Handle handle_ = nullptr;
};

using Device = Owned<gpurt_device, gpurt_device_release>;
using Scene = Owned<gpurt_scene, gpurt_scene_release>;
using Frame = Owned<gpurt_frame, gpurt_frame_release>;
using Job = Owned<gpurt_job, gpurt_job_release>;

// One function a command: adds it to the program. When it is chosen, its callback does the work and throws Failure.
void add_devices_command(CLI::App &program);
void add_info_command(CLI::App &program);
void add_render_command(CLI::App &program);
void add_merge_command(CLI::App &program);
void add_trace_command(CLI::App &program);
void add_scene_command(CLI::App &program);
void add_verify_command(CLI::App &program);
void add_bench_command(CLI::App &program);
void add_chart_command(CLI::App &program);

}  // namespace cli
