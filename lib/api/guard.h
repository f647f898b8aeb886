// The wall between C++ and C: every fallible entry point runs inside guard(), so that no exception leaves the library.
#pragma once

#include <cxxabi.h>

#include <utility>

#include "error.h"

namespace gpurt::api {

/// Text of the calling thread's last failure; "" before the first.
const char *last_error() noexcept;

/// To be called from a catch block: stores the text of the exception in flight, returns its result code.
gpurt_result report_exception(const char *function) noexcept;

/// Runs the body of the entry point `function`. Success leaves the last error as it was.
template <class Body>
gpurt_result guard(Body &&body, const char *function = __builtin_FUNCTION())
{
  try {
    std::forward<Body>(body)();
    return GPURT_OK;
  } catch (const abi::__forced_unwind &) {
    throw;  // the thread is being cancelled: swallowing this would abort the process
  } catch (...) {
    return report_exception(function);
  }
}

/// Throws where the pointer is NULL.
inline void require(const void *pointer, const char *name)
{
  if (!pointer) fail_invalid("{} is NULL", name);
}

}  // namespace gpurt::api
