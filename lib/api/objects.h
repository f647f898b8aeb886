// What the handles stand for. A child holds its parent, so that objects may be released in any order.
#pragma once

#include <map>
#include <mutex>
#include <shared_mutex>

#include "api/handles.h"
#include "backend.h"
#include "photon_maps.h"
#include "scene/compiled_scene.h"
#include "scene/scene_data.h"

namespace gpurt {

class Frame;
class Job;

namespace api {

/// The caller's log function, called by one thread at a time.
class Log {
 public:
  Log(gpurt_log_fn function, void *user) : function_(function), user_(user) {}
  void operator()(gpurt_log_level level, const std::string &message);

 private:
  const gpurt_log_fn function_;
  void *const user_;
  std::mutex mutex_;
};

struct Device {
  std::shared_ptr<Log> log;
  std::unique_ptr<Backend> backend;

  const DeviceInfo &info() const { return backend->info(); }
  bool is_cpu() const { return info().type == GPURT_DEVICE_CPU; }
  const std::shared_ptr<MemoryTracker> &memory() const { return backend->memory(); }
};

struct Buffer {
  Buffer() = default;
  Buffer(const Buffer &) = delete;
  Buffer &operator=(const Buffer &) = delete;
  ~Buffer();  // calls the caller's release function

  std::shared_ptr<Device> device;
  gpurt_storage storage = GPURT_STORAGE_HOST;
  uint64_t size_bytes = 0;
  void *data = nullptr;
  gpurt_release_fn release = nullptr;
  void *release_user = nullptr;
  Reservation reservation;
  std::shared_ptr<void> owned;  // memory of gpurt

  /// Whether the host may read and write it.
  bool is_host() const { return storage == GPURT_STORAGE_HOST || device->is_cpu(); }
};

/// A commit in force: immutable, shared by the scene, its frames and the work in flight.
struct Commit {
  std::shared_ptr<Device> device;
  Reservation reservation;  // of the compiled scene
  std::shared_ptr<const CompiledScene> compiled;
  std::shared_ptr<const CommittedScene> committed;
  double build_seconds = 0, backend_seconds = 0;  // of the whole; of the backend's part
  std::string accel_reason;
  uint64_t shape_version = 0;  // of the scene
  PatchLimits patch_limits;
};

struct Scene {
  explicit Scene(std::shared_ptr<Device> d) : device(std::move(d)) {}

  const std::shared_ptr<Device> device;

  /// Held by whoever changes the scene, from start to end.
  std::mutex changing;
  /// Held for writing while `data` changes, for reading by those who do not hold `changing`.
  std::shared_mutex data_mutex;
  SceneData data;
  Reservation loaded_memory;                // of what a file brought
  std::vector<uint32_t> shared_geometries;  // whose arrays lie in buffers; under `changing`
  std::map<uint32_t, std::shared_ptr<const HostKdTree>> imported_trees;  // under `changing`
  /// Changes with what triangles there are, but not with their vertices; under `changing`.
  uint64_t shape_version = 0;

  std::shared_ptr<const Commit> last_commit() const
  {
    const std::scoped_lock lock(commit_mutex_);
    return commit_;
  }
  /// Throws INVALID_ARGUMENT before the first commit.
  std::shared_ptr<const Commit> require_commit() const
  {
    std::shared_ptr<const Commit> commit = last_commit();
    if (!commit) fail_invalid("the scene was never committed; call gpurt_scene_commit first");
    return commit;
  }
  void set_commit(std::shared_ptr<const Commit> commit)
  {
    const std::scoped_lock lock(commit_mutex_);
    commit_.swap(commit);
  }

 private:
  mutable std::mutex commit_mutex_;
  std::shared_ptr<const Commit> commit_;
};

struct FrameObject {
  std::shared_ptr<Scene> scene;
  std::shared_ptr<const Commit> commit;
  std::shared_ptr<Frame> frame;
};

struct PhotonMapObject {
  std::shared_ptr<Device> device;
  std::shared_ptr<const PhotonMap> map;
};

struct JobObject {
  std::shared_ptr<FrameObject> frame;
  std::shared_ptr<Job> job;
};

}  // namespace api
}  // namespace gpurt
