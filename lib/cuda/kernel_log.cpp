#include "cuda/kernel_log.h"

#include <cuda_runtime_api.h>

#include <deque>
#include <mutex>
#include <unordered_map>

#include "backend.h"
#include "cuda/check.h"
#include "cuda/kernel_listing.h"

namespace gpurt::cuda {
namespace {

struct Launched {
  const char *name;
  const void *kernel;
  unsigned block_threads;
  uint64_t num_launches;
};

struct KernelLog {
  std::mutex mutex;
  std::unordered_map<const void *, size_t> indices;
  std::deque<Launched> kernels;  // in the order of their first launch
};

KernelLog &kernel_log()
{
  static KernelLog log;
  return log;
}

}  // namespace

void note_launch(const char *name, const void *kernel, unsigned block_threads)
{
  KernelLog &log = kernel_log();
  const std::lock_guard lock(log.mutex);
  const auto [found, is_new] = log.indices.try_emplace(kernel, log.kernels.size());
  if (is_new) log.kernels.push_back({name, kernel, block_threads, 0});
  ++log.kernels[found->second].num_launches;
}

std::vector<KernelInfo> list_kernels(const cudaDeviceProp &device)
{
  std::deque<Launched> kernels;
  {
    KernelLog &log = kernel_log();
    const std::lock_guard lock(log.mutex);
    kernels = log.kernels;
  }
  std::vector<KernelInfo> infos;
  for (const Launched &k : kernels) {
    cudaFuncAttributes attributes{};
    check(cudaFuncGetAttributes(&attributes, k.kernel), "cudaFuncGetAttributes");
    int blocks = 0;
    check(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&blocks, k.kernel, int(k.block_threads), 0),
          "cudaOccupancyMaxActiveBlocksPerMultiprocessor");
    KernelInfo info;
    info.name = k.name;
    info.num_launches = k.num_launches;
    info.block_threads = k.block_threads;
    info.registers = uint32_t(attributes.numRegs);
    info.local_bytes = uint32_t(attributes.localSizeBytes);
    info.shared_bytes = uint32_t(attributes.sharedSizeBytes);
    info.blocks_per_multiprocessor = uint32_t(blocks);
    info.occupancy = float(blocks) * float(k.block_threads) / float(device.maxThreadsPerMultiProcessor);
    infos.push_back(std::move(info));
  }
  return infos;
}

}  // namespace gpurt::cuda
