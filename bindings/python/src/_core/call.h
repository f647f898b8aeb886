// How every function of the C library is called: without Python's lock, and with failures as exceptions.
#pragma once

#include <pybind11/pybind11.h>

#include <string>
#include <utility>

#include "gpurt.h"

namespace gpurt_python {

namespace py = pybind11;

/// Raises the exception class of gpurt.errors that belongs to the result.
[[noreturn]] void raise_result(gpurt_result result, const std::string &message);

/// Raises gpurt.InvalidArgument.
[[noreturn]] void raise_invalid(const std::string &message);

/// True on a thread that is inside a log or progress callback, where the C library must not be called.
bool in_callback();

/// Refuses calls from inside a callback, and gives back the handles that were dropped inside one.
void enter_library();

/// Python's lock is released while this lives.
///
/// A thread that asks for the lock when the interpreter has begun to end is torn down in the middle, which C++ does
/// not survive. So wait_for_calls() waits until every thread has its lock again, and from then on it is kept.
class Unlocked {
 public:
  Unlocked();
  ~Unlocked();
  Unlocked(const Unlocked &) = delete;
  Unlocked &operator=(const Unlocked &) = delete;

 private:
  PyThreadState *state_ = nullptr;
};

/// Called when the interpreter begins to end.
void wait_for_calls();

/// Calls a function of the library that returns a gpurt_result. The lock is always released: any call may wait for
/// a thread that needs it for a callback. The text of a failure is read before another call can replace it.
template <class Function>
gpurt_result call_unchecked(Function &&function, std::string &message)
{
  enter_library();
  const Unlocked unlocked;
  const gpurt_result result = std::forward<Function>(function)();
  if (result != GPURT_OK) message = gpurt_last_error();
  return result;
}

template <class Function>
void call(Function &&function)
{
  std::string message;
  const gpurt_result result = call_unchecked(std::forward<Function>(function), message);
  if (result != GPURT_OK) raise_result(result, message);
}

/// Takes a reference away, now or, where Python's lock is not held, at the next call of the library.
void drop_object(PyObject *object);

/// Gives a handle back, now or, from inside a callback, at the next call of the library.
void release_handle(gpurt_result (*release)(void *), void *handle);

/// Owns one reference of a handle.
template <class Handle, gpurt_result (*Release)(Handle)>
class Owner {
 public:
  Owner() = default;
  Owner(Owner &&other) noexcept : handle_(std::exchange(other.handle_, nullptr)) {}
  Owner &operator=(Owner &&) = delete;
  ~Owner()
  {
    if (handle_) release_handle([](void *handle) { return Release(static_cast<Handle>(handle)); }, handle_);
  }

  Handle get() const { return handle_; }
  Handle *out() { return &handle_; }

 private:
  Handle handle_ = nullptr;
};

}  // namespace gpurt_python
