// The one exception type that carries a result code to the ABI's guard.
#pragma once

#include <fmt/format.h>

#include <stdexcept>
#include <string>
#include <utility>

#include "gpurt.h"

namespace gpurt {

class Error : public std::runtime_error {
 public:
  Error(gpurt_result result, const std::string &message) : std::runtime_error(message), result_(result) {}
  gpurt_result result() const { return result_; }

 private:
  gpurt_result result_;
};

template <class... Args>
[[noreturn]] void fail(gpurt_result result, fmt::format_string<Args...> format, Args &&...args)
{
  throw Error(result, fmt::format(format, std::forward<Args>(args)...));
}

template <class... Args>
[[noreturn]] void fail_invalid(fmt::format_string<Args...> format, Args &&...args)
{
  throw Error(GPURT_ERROR_INVALID_ARGUMENT, fmt::format(format, std::forward<Args>(args)...));
}

}  // namespace gpurt
