#include "call.h"

#include <condition_variable>
#include <mutex>
#include <vector>

namespace gpurt_python {

namespace {

struct DroppedHandle {
  gpurt_result (*release)(void *);
  void *handle;
};

// Never destroyed: objects may be dropped while the process ends.
std::mutex &dropped_mutex()
{
  static auto *mutex = new std::mutex;
  return *mutex;
}

std::vector<DroppedHandle> &dropped_handles()
{
  static auto *handles = new std::vector<DroppedHandle>;
  return *handles;
}

std::vector<PyObject *> &dropped_objects()
{
  static auto *objects = new std::vector<PyObject *>;
  return *objects;
}

// With Python's lock held. What the objects' own ends drop is taken too.
void free_dropped_objects()
{
  for (;;) {
    std::vector<PyObject *> objects;
    {
      std::lock_guard lock(dropped_mutex());
      objects.swap(dropped_objects());
    }
    if (objects.empty()) return;
    for (PyObject *object : objects) Py_DECREF(object);
  }
}

struct Calls {
  std::mutex mutex;
  std::condition_variable none;
  int num_unlocked = 0;
  bool ended = false;
};

// Never destroyed, as above.
Calls &calls()
{
  static auto *instance = new Calls;
  return *instance;
}

const char *class_name(gpurt_result result)
{
  switch (result) {
    case GPURT_ERROR_INVALID_ARGUMENT:
      return "InvalidArgument";
    case GPURT_ERROR_OUT_OF_MEMORY:
      return "OutOfMemory";
    case GPURT_ERROR_UNSUPPORTED:
      return "Unsupported";
    case GPURT_ERROR_CANCELLED:
      return "Cancelled";
    case GPURT_ERROR_DEVICE:
      return "DeviceError";
    case GPURT_ERROR_TIMEOUT:
      return "Timeout";
    case GPURT_ERROR_IO:
      return "FileError";
    case GPURT_ERROR_INTERNAL:
      return "InternalError";
    default:
      return "Error";
  }
}

}  // namespace

void raise_result(gpurt_result result, const std::string &message)
{
  const py::object type = py::module_::import("gpurt.errors").attr(class_name(result));
  // The text may quote a path that is not UTF-8.
  PyObject *text =
      PyUnicode_DecodeUTF8(message.data(), static_cast<Py_ssize_t>(message.size()), "backslashreplace");
  PyErr_SetObject(type.ptr(), py::reinterpret_steal<py::str>(text).ptr());
  throw py::error_already_set();
}

void raise_invalid(const std::string &message) { raise_result(GPURT_ERROR_INVALID_ARGUMENT, message); }

void enter_library()
{
  if (in_callback())
    raise_invalid("log and progress callbacks must not use gpurt; note what to do and return");
  std::vector<DroppedHandle> handles;
  {
    std::lock_guard lock(dropped_mutex());
    handles.swap(dropped_handles());
  }
  if (!handles.empty()) {
    const Unlocked unlocked;
    for (const DroppedHandle &dropped : handles) dropped.release(dropped.handle);
  }
  free_dropped_objects();
}

void drop_object(PyObject *object)
{
  if (PyGILState_Check()) {
    Py_DECREF(object);
    return;
  }
  std::lock_guard lock(dropped_mutex());
  dropped_objects().push_back(object);
}

void release_handle(gpurt_result (*release)(void *), void *handle)
{
  if (in_callback()) {
    std::lock_guard lock(dropped_mutex());
    dropped_handles().push_back({release, handle});
    return;
  }
  {
    // Releasing a job waits for its threads, which may be waiting for Python's lock.
    const Unlocked unlocked;
    release(handle);
  }
  free_dropped_objects();
}

Unlocked::Unlocked()
{
  std::lock_guard lock(calls().mutex);
  if (calls().ended) return;
  ++calls().num_unlocked;
  state_ = PyEval_SaveThread();
}

Unlocked::~Unlocked()
{
  if (!state_) return;
  PyEval_RestoreThread(state_);
  std::lock_guard lock(calls().mutex);
  if (--calls().num_unlocked == 0) calls().none.notify_all();
}

void wait_for_calls()
{
  const py::gil_scoped_release release;
  std::unique_lock lock(calls().mutex);
  calls().ended = true;
  calls().none.wait(lock, [] { return calls().num_unlocked == 0; });
}

}  // namespace gpurt_python
