#include "cpu/cpu_backend.h"

#include <sys/sysinfo.h>
#include <tbb/global_control.h>
#include <tbb/info.h>

#include <cstdlib>
#include <cstring>
#include <fstream>
#include <mutex>

#include "cpu/committed_scene.h"
#include "cpu/factory.h"
#include "cpu/kernels.h"
#include "cpu/photon/photon_map.h"

namespace gpurt {
namespace {

std::string processor_name()
{
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);) {
    if (line.rfind("model name", 0) != 0) continue;
    const size_t colon = line.find(": ");
    if (colon != std::string::npos) return line.substr(colon + 2);
  }
  return "CPU";
}

uint64_t physical_memory()
{
  struct sysinfo s = {};
  return sysinfo(&s) == 0 ? uint64_t(s.totalram) * s.mem_unit : 0;
}

uint32_t thread_count(const BackendOptions &options)
{
  // What the process's affinity allows.
  return options.num_threads != 0 ? options.num_threads : uint32_t(tbb::info::default_concurrency());
}

// TBB runs no more threads than the process may use unless it is told to. Of several limits the smallest counts, so that
// there is only one, for the largest number that was ever asked for.
void allow_threads(uint32_t num_threads)
{
  static std::mutex mutex;
  static std::unique_ptr<tbb::global_control> limit;
  static size_t allowed = size_t(tbb::info::default_concurrency());
  std::lock_guard lock(mutex);
  if (num_threads <= allowed) return;
  allowed = num_threads;
  limit.reset();
  limit = std::make_unique<tbb::global_control>(tbb::global_control::max_allowed_parallelism, allowed);
}

DeviceInfo describe(uint32_t num_threads)
{
  DeviceInfo info;
  info.type = GPURT_DEVICE_CPU;
  info.num_threads = num_threads;
  info.memory_bytes = physical_memory();
  info.name = processor_name();
  info.instruction_set = cpu_kernels().isa;
  return info;
}

}  // namespace

CpuBackend::CpuBackend(const BackendOptions &options)
    : info_(describe(thread_count(options))),
      memory_(std::make_shared<MemoryTracker>(options.memory_limit_bytes)),
      log_(options.log),
      arena_(std::make_shared<tbb::task_arena>(int(info_.num_threads)))
{
  allow_threads(info_.num_threads);
}

std::shared_ptr<const CommittedScene> CpuBackend::commit(std::shared_ptr<const CompiledScene> scene,
                                                         const BuildOptions &options)
{
  const AccelContext context = {scene, memory_, info_.num_threads, log_};
  std::unique_ptr<Accelerator> accelerator;
  arena_->execute([&] {
    switch (options.accel) {
      case Accel::Auto:
      case Accel::Embree:
        // Embree has no test in double precision: asking for it decides where the caller did not.
        accelerator = options.accel == Accel::Auto && options.triangle_test == TriangleTest::Double
                          ? make_kd_accelerator(context, options)
                          : make_embree_accelerator(context, options);
        break;
      case Accel::KdTree:
        accelerator = make_kd_accelerator(context, options);
        break;
      case Accel::Bvh:
        accelerator = make_bvh_accelerator(context, options);
        break;
    }
  });
  return std::make_shared<CpuScene>(std::move(scene), std::move(accelerator), arena_, memory_);
}

std::shared_ptr<void> CpuBackend::allocate(uint64_t bytes)
{
  auto reservation = std::make_shared<Reservation>(memory_, bytes, "a buffer");
  void *data = std::calloc(bytes == 0 ? 1 : bytes, 1);
  if (data == nullptr) fail(GPURT_ERROR_OUT_OF_MEMORY, "the system has no {} bytes for a buffer", bytes);
  return {data, [reservation](void *p) { std::free(p); }};
}

void CpuBackend::copy_to_host(void *host, const void *device, uint64_t bytes)
{
  if (bytes != 0) std::memcpy(host, device, bytes);
}

void CpuBackend::copy_to_device(void *device, const void *host, uint64_t bytes)
{
  if (bytes != 0) std::memcpy(device, host, bytes);
}

std::shared_ptr<const PhotonMap> CpuBackend::make_photon_map(const PhotonMapRequest &request)
{
  return std::make_shared<CpuPhotonMap>(request, arena_, memory_);
}

namespace cpu {
namespace {

std::vector<DeviceInfo> enumerate() { return {describe(uint32_t(tbb::info::default_concurrency()))}; }

std::unique_ptr<Backend> create(const BackendOptions &options)
{
  if (options.ordinal != 0)
    fail(GPURT_ERROR_DEVICE, "there is no CPU device {}; the only one has ordinal 0", options.ordinal);
  return std::make_unique<CpuBackend>(options);
}

}  // namespace

const BackendFactory &factory()
{
  static const BackendFactory cpu = {GPURT_DEVICE_CPU, enumerate, create};
  return cpu;
}

}  // namespace cpu
}  // namespace gpurt
