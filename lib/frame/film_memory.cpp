#include "frame/film_memory.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <new>
#include <utility>

namespace gpurt {

namespace {

// Smaller ones cost less than a look at what is kept.
constexpr size_t large_bytes = size_t(4) << 20;
constexpr size_t most_kept_bytes = size_t(1) << 30;
constexpr size_t chunk_bytes = size_t(1) << 20;

// The block that was given back last.
struct KeptMemory {
  std::mutex mutex;
  void *data = nullptr;
  size_t capacity = 0;
};

// Never destroyed: a caller's static objects may release their frames after those of the library are gone.
KeptMemory &kept_memory()
{
  static auto *const kept = new KeptMemory;
  return *kept;
}

}  // namespace

void clear_memory(void *data, size_t bytes)
{
  if (bytes < large_bytes) {
    std::memset(data, 0, bytes);
    return;
  }
  // Whoever waits for it must not begin another of its own tasks meanwhile, which may use the same film.
  tbb::this_task_arena::isolate([&] {
    tbb::parallel_for(size_t(0), (bytes + chunk_bytes - 1) / chunk_bytes, [&](size_t i) {
      const size_t first = i * chunk_bytes;
      std::memset(static_cast<char *>(data) + first, 0, std::min(chunk_bytes, bytes - first));
    });
  });
}

void *take_memory(size_t bytes, size_t &capacity)
{
  void *data = nullptr;
  capacity = bytes;
  if (bytes >= large_bytes) {
    KeptMemory &kept = kept_memory();
    const std::scoped_lock lock(kept.mutex);
    // Not so much more that most of it would lie idle.
    if (kept.capacity >= bytes && kept.capacity / 2 <= bytes) {
      data = std::exchange(kept.data, nullptr);
      capacity = std::exchange(kept.capacity, 0);
    }
  }
  if (data == nullptr) data = std::malloc(bytes);
  if (data == nullptr) throw std::bad_alloc();
  return data;
}

void give_memory_back(void *data, size_t capacity) noexcept
{
  if (capacity >= large_bytes && capacity <= most_kept_bytes) {
    KeptMemory &kept = kept_memory();
    const std::scoped_lock lock(kept.mutex);
    std::swap(kept.data, data);
    kept.capacity = capacity;
  }
  std::free(data);
}

}  // namespace gpurt
