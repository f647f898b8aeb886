#include "callbacks.h"

#include <condition_variable>
#include <mutex>
#include <unordered_map>

#include "call.h"

namespace gpurt_python {

namespace {

thread_local bool inside_callback = false;

struct Registry {
  std::mutex mutex;
  std::condition_variable idle;
  std::unordered_map<std::uintptr_t, PyObject *> weak_references;
  std::uintptr_t last_id = 0;
  int num_running = 0;
  bool stopped = false;
};

// Never destroyed: the library's threads may call while the process ends.
Registry &registry()
{
  static auto *instance = new Registry;
  return *instance;
}

// A running callback. stop_callbacks() waits for it, so the interpreter is there as long as this lives.
class Running {
 public:
  Running()
  {
    std::lock_guard lock(registry().mutex);
    started_ = !registry().stopped;
    if (started_) ++registry().num_running;
  }
  ~Running()
  {
    if (!started_) return;
    std::lock_guard lock(registry().mutex);
    if (--registry().num_running == 0) registry().idle.notify_all();
  }
  Running(const Running &) = delete;
  Running &operator=(const Running &) = delete;
  bool started() const { return started_; }

 private:
  bool started_ = false;
};

class InsideCallback {
 public:
  InsideCallback() { inside_callback = true; }
  ~InsideCallback() { inside_callback = false; }
  InsideCallback(const InsideCallback &) = delete;
  InsideCallback &operator=(const InsideCallback &) = delete;
};

py::object find_callback(std::uintptr_t id)
{
  PyObject *weak = nullptr;
  {
    std::lock_guard lock(registry().mutex);
    const auto found = registry().weak_references.find(id);
    if (found != registry().weak_references.end()) weak = py::handle(found->second).inc_ref().ptr();
  }
  if (!weak) return py::none();
  return py::reinterpret_steal<py::object>(weak)();
}

template <class CallFunction>
void run_callback(void *user, CallFunction &&call_function)
{
  const Running running;
  if (!running.started()) return;
  const InsideCallback inside;  // outlives the lock: giving that up can run finalisers
  const py::gil_scoped_acquire acquire;
  const py::object callback = find_callback(reinterpret_cast<std::uintptr_t>(user));
  if (callback.is_none()) return;
  try {
    call_function(callback);
  } catch (py::error_already_set &error) {
    // Kept until a call of the library can raise it; the first one counts.
    if (callback.attr("error").is_none()) callback.attr("error") = error.value();
  }
}

}  // namespace

bool in_callback() { return inside_callback; }

CallbackId::CallbackId(const py::object &callback)
{
  if (callback.is_none()) return;
  PyObject *weak = PyWeakref_NewRef(callback.ptr(), nullptr);
  if (!weak) throw py::error_already_set();
  std::lock_guard lock(registry().mutex);
  id_ = ++registry().last_id;
  registry().weak_references[id_] = weak;
}

CallbackId::CallbackId(CallbackId &&other) noexcept : id_(other.id_) { other.id_ = 0; }

CallbackId::~CallbackId()
{
  if (id_ == 0) return;
  PyObject *weak = nullptr;
  {
    std::lock_guard lock(registry().mutex);
    const auto found = registry().weak_references.find(id_);
    weak = found->second;
    registry().weak_references.erase(found);
  }
  Py_DECREF(weak);
}

void forward_log(void *user, gpurt_log_level level, const char *message)
{
  run_callback(user, [&](const py::object &callback) {
    callback(
        static_cast<int>(level),
        py::reinterpret_steal<py::str>(PyUnicode_DecodeUTF8(
            message, static_cast<Py_ssize_t>(std::char_traits<char>::length(message)), "backslashreplace")));
  });
}

void forward_progress(void *user, double done, double total)
{
  run_callback(user, [&](const py::object &callback) { callback(done, total); });
}

void stop_callbacks()
{
  const py::gil_scoped_release release;
  std::unique_lock lock(registry().mutex);
  registry().stopped = true;
  registry().idle.wait(lock, [] { return registry().num_running == 0; });
}

}  // namespace gpurt_python
