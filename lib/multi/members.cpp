#include "multi/members.h"

#include <exception>
#include <thread>

#include "error.h"

namespace gpurt::multi {

std::string Members::name(size_t member) const
{
  const DeviceInfo &info = backends[member]->info();
  return fmt::format("{} device {}", info.type == GPURT_DEVICE_CUDA ? "CUDA" : "CPU", info.ordinal);
}

std::string Members::ordinals() const
{
  std::string text;
  for (size_t i = 0; i < size(); ++i) {
    if (i != 0) text += i + 1 == size() ? " and " : ", ";
    text += std::to_string(backends[i]->info().ordinal);
  }
  return text;
}

size_t Members::holder(const void *data, const char *argument) const
{
  for (size_t i = 0; i < size(); ++i) {
    if (backends[i]->holds(data)) return i;
  }
  fail_invalid("{} lies in the memory of none of the devices {} of the scene; copy it to one of them",
               argument, ordinals());
}

size_t Members::with_ordinal(uint32_t ordinal) const
{
  for (size_t i = 0; i < size(); ++i) {
    if (backends[i]->info().ordinal == ordinal) return i;
  }
  fail_invalid("ordinal is {}, but the device is made of the devices {}", ordinal, ordinals());
}

void run_named(const Members &members, size_t member, const std::function<void()> &work)
{
  try {
    work();
  } catch (const Error &e) {
    throw Error(e.result(), fmt::format("{}: {}", members.name(member), e.what()));
  }
}

void run_side_by_side(size_t n, const std::function<void(size_t i)> &work)
{
  if (n == 0) return;
  std::vector<std::exception_ptr> errors(n);
  const auto run = [&](size_t i) {
    try {
      work(i);
    } catch (...) {
      errors[i] = std::current_exception();
    }
  };
  std::vector<std::thread> threads;
  threads.reserve(n);
  size_t num_started = 1;
  try {
    for (; num_started < n; ++num_started) threads.emplace_back(run, num_started);
  } catch (const std::exception &) {
    // No thread to be had: the caller's does the rest, one after another.
  }
  run(0);
  for (size_t i = num_started; i < n; ++i) run(i);
  for (std::thread &thread : threads) thread.join();
  for (const std::exception_ptr &error : errors) {
    if (error) std::rethrow_exception(error);
  }
}

}  // namespace gpurt::multi
