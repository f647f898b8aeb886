// Device memory of one backend, counted against its limit, and the one type that owns it.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <memory>
#include <span>
#include <utility>

#include "cuda/check.h"

namespace gpurt {
class MemoryTracker;  // lib/memory.h, whose error texts nvcc cannot read
}

namespace gpurt::cuda {

/// Makes a device current for the calling thread, and the caller's current again at the end. Throws DEVICE where it is lost.
class DeviceScope {
 public:
  explicit DeviceScope(int ordinal);
  ~DeviceScope();
  DeviceScope(const DeviceScope &) = delete;
  DeviceScope &operator=(const DeviceScope &) = delete;

 private:
  int caller_ = -1;  // -1: nothing to restore
};

/// Where buffers come from. Freed blocks stay in a pool of the device for the next call, and go back to it before any
/// allocation fails. The limit holds for what buffers take, and for what the pool holds: in blocks of 32 MiB, of which there are
/// as many as the limit has room for, and at least one. Used from any thread.
class DeviceMemory {
 public:
  /// The device `ordinal` must be current.
  DeviceMemory(int ordinal, uint64_t limit_bytes);
  ~DeviceMemory();
  DeviceMemory(const DeviceMemory &) = delete;
  DeviceMemory &operator=(const DeviceMemory &) = delete;

  int ordinal() const { return ordinal_; }
  /// What the device has given away to the pool: more than is used. 0 where the device has no pools.
  uint64_t held_bytes() const;
  const std::shared_ptr<MemoryTracker> &tracker() const { return tracker_; }

  /// Memory that every stream may use at once. Throws OUT_OF_MEMORY naming `what`.
  void *allocate(uint64_t bytes, const char *what);
  /// Work that uses the memory must have ended.
  void free(void *data, uint64_t bytes) noexcept;
  /// Lets what is freed from now on be used again only after the work that is on the legacy default stream now.
  void wait_for_default_stream() noexcept;
  /// Memory for work that is queued on `stream` from here on; null where there is none, or the device cannot do it.
  void *allocate_on(cudaStream_t stream, uint64_t bytes);
  /// Goes once the work queued so far is done.
  void free_on(cudaStream_t stream, void *data, uint64_t bytes) noexcept;

 private:
  void make_pool();
  void drop_pool() noexcept;
  cudaError_t take_from_pool(void **data, uint64_t bytes, cudaStream_t stream);

  const int ordinal_;
  const std::shared_ptr<MemoryTracker> tracker_;
  cudaMemPool_t pool_ = nullptr;   // null: the device has no pools, memory comes from cudaMalloc
  cudaStream_t stream_ = nullptr;  // carries nothing but allocations
};

/// An array in device memory. Whoever starts work on it waits for that work before letting go of it.
template <class T>
class DeviceBuffer {
 public:
  DeviceBuffer() = default;
  DeviceBuffer(std::shared_ptr<DeviceMemory> memory, uint64_t count, const char *what)
      : memory_(std::move(memory)),
        data_(static_cast<T *>(memory_->allocate(count * sizeof(T), what))),
        count_(count)
  {}
  DeviceBuffer(DeviceBuffer &&other) noexcept
      : memory_(std::move(other.memory_)),
        data_(std::exchange(other.data_, nullptr)),
        count_(std::exchange(other.count_, 0))
  {}
  DeviceBuffer &operator=(DeviceBuffer &&other) noexcept
  {
    std::swap(memory_, other.memory_);
    std::swap(data_, other.data_);
    std::swap(count_, other.count_);
    return *this;
  }
  ~DeviceBuffer()
  {
    if (data_ != nullptr) memory_->free(data_, bytes());
  }

  T *data() const { return data_; }
  uint64_t size() const { return count_; }
  uint64_t bytes() const { return count_ * sizeof(T); }

 private:
  std::shared_ptr<DeviceMemory> memory_;
  T *data_ = nullptr;
  uint64_t count_ = 0;
};

/// Words for what is queued on a stream while this lives; data() is null where there was no memory for them.
class StreamWords {
 public:
  StreamWords(DeviceMemory &memory, cudaStream_t stream, uint64_t count)
      : memory_(memory),
        stream_(stream),
        bytes_(count * sizeof(uint32_t)),
        data_(memory.allocate_on(stream, bytes_))
  {}
  ~StreamWords() { memory_.free_on(stream_, data_, bytes_); }
  StreamWords(const StreamWords &) = delete;
  StreamWords &operator=(const StreamWords &) = delete;
  uint32_t *data() const { return static_cast<uint32_t *>(data_); }

 private:
  DeviceMemory &memory_;
  cudaStream_t stream_;
  uint64_t bytes_;
  void *data_;
};

/// Copies host values to device memory that has room for them, and waits for the copy.
template <class T>
void copy_to_device(T *to, std::span<const T> from, cudaStream_t stream)
{
  if (from.empty()) return;
  check(cudaMemcpyAsync(to, from.data(), from.size_bytes(), cudaMemcpyHostToDevice, stream),
        "cudaMemcpyAsync");
  check(cudaStreamSynchronize(stream), "cudaStreamSynchronize");
}

/// Copies host values into a new buffer and waits for the copy.
template <class T>
DeviceBuffer<T> upload(const std::shared_ptr<DeviceMemory> &memory, std::span<const T> values,
                       const char *what, cudaStream_t stream)
{
  DeviceBuffer<T> buffer(memory, values.size(), what);
  copy_to_device(buffer.data(), values, stream);
  return buffer;
}

/// Throws INVALID_ARGUMENT where the array `name` of a request about `object`, which lies on the device, is host memory
/// that the device cannot reach, or memory of another device. NULL is fine.
void check_device_pointer(const void *pointer, const char *name, int ordinal, const char *object);

}  // namespace gpurt::cuda
