// Python functions that the library calls from its own threads.
//
// The library holds a number, not a pointer: a message that arrives late, when the Python object is gone or the
// interpreter is ending, finds nothing and is left out. The registry holds a weak reference, so that callbacks take
// part in Python's garbage collection. The object that it points to is a gpurt._callbacks.Callback: callable, with
// an attribute `error` that receives what the function raised.
#pragma once

#include <pybind11/pybind11.h>

#include <cstdint>

#include "gpurt.h"

namespace gpurt_python {

namespace py = pybind11;

/// A registered callback; the registration ends with it.
class CallbackId {
 public:
  CallbackId() = default;
  explicit CallbackId(const py::object &callback);  // None: no callback
  CallbackId(CallbackId &&other) noexcept;
  CallbackId &operator=(CallbackId &&) = delete;
  ~CallbackId();

  bool is_set() const { return id_ != 0; }
  void *user() const { return reinterpret_cast<void *>(id_); }

 private:
  std::uintptr_t id_ = 0;
};

void forward_log(void *user, gpurt_log_level level, const char *message);
void forward_progress(void *user, double done, double total);

/// Called when the interpreter begins to end: no callback starts after it returns and none is running.
void stop_callbacks();

}  // namespace gpurt_python
