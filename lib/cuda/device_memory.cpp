#include "cuda/device_memory.h"

#include <algorithm>

#include "error.h"
#include "memory.h"

namespace gpurt::cuda {
namespace {

// A pool takes the device's memory in blocks of this size, whatever is asked of it.
constexpr uint64_t pool_block_bytes = uint64_t(32) << 20;

// What a pool may hold, free blocks among it, so that a limit is kept by what the device gives away: 0 for no limit. Below one
// block there is no less than that.
uint64_t most_pool_bytes(uint64_t limit_bytes)
{
  if (limit_bytes == 0) return 0;
  return std::max(limit_bytes / pool_block_bytes, uint64_t(1)) * pool_block_bytes;
}

}  // namespace

DeviceScope::DeviceScope(int ordinal)
{
  check_is_not_lost(ordinal);
  int current = -1;
  check(cudaGetDevice(&current), "cudaGetDevice");
  if (current == ordinal) return;
  check(cudaSetDevice(ordinal), "cudaSetDevice");
  caller_ = current;
}

DeviceScope::~DeviceScope()
{
  if (caller_ >= 0) ignore(cudaSetDevice(caller_));
}

DeviceMemory::DeviceMemory(int ordinal, uint64_t limit_bytes)
    : ordinal_(ordinal), tracker_(std::make_shared<MemoryTracker>(limit_bytes))
{
  try {
    make_pool();
  } catch (...) {
    drop_pool();
    throw;
  }
}

DeviceMemory::~DeviceMemory() { drop_pool(); }

void DeviceMemory::make_pool()
{
  int has_pools = 0;
  check(cudaDeviceGetAttribute(&has_pools, cudaDevAttrMemoryPoolsSupported, ordinal_),
        "cudaDeviceGetAttribute");
  if (!has_pools) return;
  check(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking), "cudaStreamCreateWithFlags");
  cudaMemPoolProps properties{};
  properties.allocType = cudaMemAllocationTypePinned;
  properties.location.type = cudaMemLocationTypeDevice;
  properties.location.id = ordinal_;
  properties.maxSize = most_pool_bytes(tracker_->limit());
  check(cudaMemPoolCreate(&pool_, &properties), "cudaMemPoolCreate");
  uint64_t keep_all = UINT64_MAX;
  check(cudaMemPoolSetAttribute(pool_, cudaMemPoolAttrReleaseThreshold, &keep_all),
        "cudaMemPoolSetAttribute");
}

void DeviceMemory::drop_pool() noexcept
{
  if (stream_ != nullptr) ignore(cudaStreamSynchronize(stream_));
  if (pool_ != nullptr) ignore(cudaMemPoolDestroy(pool_));
  if (stream_ != nullptr) ignore(cudaStreamDestroy(stream_));
}

cudaError_t DeviceMemory::take_from_pool(void **data, uint64_t bytes, cudaStream_t stream)
{
  cudaError_t status = cudaMallocFromPoolAsync(data, bytes, pool_, stream);
  if (status != cudaErrorMemoryAllocation) return status;
  // Free blocks of other sizes may stand in the way: give them back to the device and try once more.
  (void)cudaGetLastError();
  check(cudaStreamSynchronize(stream_), "cudaStreamSynchronize");
  check(cudaMemPoolTrimTo(pool_, 0), "cudaMemPoolTrimTo");
  return cudaMallocFromPoolAsync(data, bytes, pool_, stream);
}

void *DeviceMemory::allocate(uint64_t bytes, const char *what)
{
  if (bytes == 0) return nullptr;
  const DeviceScope scope(ordinal_);
  Reservation reserved(tracker_, bytes, what);
  void *data = nullptr;
  cudaError_t status = cudaSuccess;
  if (pool_ == nullptr) {
    status = cudaMalloc(&data, bytes);
  } else {
    status = take_from_pool(&data, bytes, stream_);
    if (status == cudaSuccess) status = cudaStreamSynchronize(stream_);
  }
  if (status == cudaErrorMemoryAllocation) {
    (void)cudaGetLastError();
    const uint64_t limit = tracker_->limit();
    if (limit != 0 && pool_ != nullptr && held_bytes() + bytes + pool_block_bytes > limit) {
      fail(GPURT_ERROR_OUT_OF_MEMORY,
           "{} needs {} bytes, and of the memory limit of {} bytes no such piece is left: memory comes in "
           "blocks of {} bytes, and {} are in use; raise memory_limit_bytes or make the scene or frame "
           "smaller",
           what, bytes, limit, pool_block_bytes, tracker_->used() - bytes);
    }
    size_t free_bytes = 0, total_bytes = 0;
    ignore(cudaMemGetInfo(&free_bytes, &total_bytes));
    fail(GPURT_ERROR_OUT_OF_MEMORY,
         "{} needs {} bytes, but {} of the device's {} bytes are free; make the scene or "
         "batch smaller, or free memory that other programs hold on the device",
         what, bytes, free_bytes, total_bytes);
  }
  check(status, "cudaMallocFromPoolAsync");
  reserved.disown();
  return data;
}

void DeviceMemory::free(void *data, uint64_t bytes) noexcept
{
  if (data == nullptr) return;
  int caller = -1;
  ignore(cudaGetDevice(&caller));
  ignore(cudaSetDevice(ordinal_));
  if (pool_ == nullptr) ignore(cudaFree(data));
  else ignore(cudaFreeAsync(data, stream_));
  if (caller >= 0 && caller != ordinal_) ignore(cudaSetDevice(caller));
  tracker_->release(bytes);
}

uint64_t DeviceMemory::held_bytes() const
{
  uint64_t bytes = 0;
  if (pool_ != nullptr) {
    check(cudaMemPoolGetAttribute(pool_, cudaMemPoolAttrReservedMemCurrent, &bytes),
          "cudaMemPoolGetAttribute");
  }
  return bytes;
}

void DeviceMemory::wait_for_default_stream() noexcept
{
  if (pool_ == nullptr) return;  // cudaFree waits for everything
  int caller = -1;
  cudaEvent_t event = nullptr;
  ignore(cudaGetDevice(&caller));
  ignore(cudaSetDevice(ordinal_));
  if (cudaEventCreateWithFlags(&event, cudaEventDisableTiming) == cudaSuccess) {
    ignore(cudaEventRecord(event, cudaStreamLegacy));
    ignore(cudaStreamWaitEvent(stream_, event, 0));
    ignore(cudaEventDestroy(event));
  } else {
    ignore(cudaStreamSynchronize(cudaStreamLegacy));
  }
  if (caller >= 0 && caller != ordinal_) ignore(cudaSetDevice(caller));
}

void *DeviceMemory::allocate_on(cudaStream_t stream, uint64_t bytes)
{
  if (pool_ == nullptr || bytes == 0) return nullptr;
  try {
    Reservation reserved(tracker_, bytes, "a batch's working memory");
    void *data = nullptr;
    const cudaError_t status = take_from_pool(&data, bytes, stream);
    if (status == cudaErrorMemoryAllocation) {
      (void)cudaGetLastError();
      return nullptr;
    }
    check(status, "cudaMallocFromPoolAsync");
    reserved.disown();
    return data;
  } catch (const Error &e) {
    if (e.result() == GPURT_ERROR_OUT_OF_MEMORY) return nullptr;
    throw;
  }
}

void DeviceMemory::free_on(cudaStream_t stream, void *data, uint64_t bytes) noexcept
{
  if (data == nullptr) return;
  ignore(cudaFreeAsync(data, stream));
  tracker_->release(bytes);
}

void check_device_pointer(const void *pointer, const char *name, int ordinal, const char *object)
{
  if (pointer == nullptr) return;
  cudaPointerAttributes attributes{};
  check(cudaPointerGetAttributes(&attributes, pointer), "cudaPointerGetAttributes");
  if (attributes.type == cudaMemoryTypeUnregistered) {
    fail_invalid(
        "{} is host memory, which the CUDA device cannot reach, or memory that was freed; set storage to "
        "GPURT_STORAGE_HOST for host memory",
        name);
  }
  if (attributes.type == cudaMemoryTypeDevice && attributes.device != ordinal) {
    fail_invalid("{} lies on CUDA device {}, {} on CUDA device {}; copy it there first", name,
                 attributes.device, object, ordinal);
  }
}

}  // namespace gpurt::cuda
