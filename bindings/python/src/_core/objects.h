// The classes of the module: one owner of a C handle each. The public package wraps them.
#pragma once

#include <pybind11/pybind11.h>

#include <utility>

#include "call.h"
#include "callbacks.h"
#include "gpurt.h"

namespace gpurt_python {

struct Device {
  explicit Device(CallbackId &&callback) : log(std::move(callback)) {}

  CallbackId log;
  Owner<gpurt_device, gpurt_device_release> handle;
};

struct Buffer {
  Owner<gpurt_buffer, gpurt_buffer_release> handle;
};

struct Scene {
  Owner<gpurt_scene, gpurt_scene_release> handle;
};

struct PhotonMap {
  Owner<gpurt_photon_map, gpurt_photon_map_release> handle;
};

struct Frame {
  Owner<gpurt_frame, gpurt_frame_release> handle;
};

/// A job is known to stop_jobs() while it lives.
struct Job {
  explicit Job(CallbackId &&callback);
  ~Job();
  Job(const Job &) = delete;
  Job &operator=(const Job &) = delete;

  CallbackId progress;
  Owner<gpurt_job, gpurt_job_release> handle;
};

/// Called when the interpreter begins to end: cancels the jobs that still run and waits for them.
void stop_jobs();

void bind_device(py::module_ &module);
void bind_buffer(py::module_ &module);
void bind_scene(py::module_ &module);
void bind_trace(py::class_<Scene> &scene);
void bind_photons(py::module_ &module);
void bind_frame(py::module_ &module);

}  // namespace gpurt_python
