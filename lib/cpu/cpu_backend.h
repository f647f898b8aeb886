// The CPU device: its threads, its memory, and scenes committed to it.
#pragma once

#include <tbb/task_arena.h>

#include "backend.h"
#include "photon_maps.h"

namespace gpurt {

class CpuBackend final : public Backend, public PhotonMaps {
 public:
  explicit CpuBackend(const BackendOptions &options);

  const DeviceInfo &info() const override { return info_; }
  const std::shared_ptr<MemoryTracker> &memory() const override { return memory_; }
  std::shared_ptr<const CommittedScene> commit(std::shared_ptr<const CompiledScene> scene,
                                               const BuildOptions &options) override;
  std::shared_ptr<void> allocate(uint64_t bytes) override;
  void copy_to_host(void *host, const void *device, uint64_t bytes) override;
  void copy_to_device(void *device, const void *host, uint64_t bytes) override;
  bool holds(const void *) const override { return true; }
  std::shared_ptr<const PhotonMap> make_photon_map(const PhotonMapRequest &request) override;

 private:
  DeviceInfo info_;
  std::shared_ptr<MemoryTracker> memory_;
  std::function<void(gpurt_log_level, const std::string &)> log_;
  std::shared_ptr<tbb::task_arena> arena_;
};

}  // namespace gpurt
