// Memory of films: zeros, and kept for the next film.
#pragma once

#include <cstddef>

namespace gpurt {

/// At least `bytes` zeros, aligned for any type; `capacity` is what there is. Large blocks are cleared by all threads, and may
/// be what the last film had: pages that the system maps anew cost ten times as much. Throws std::bad_alloc.
void *take_zeroed_memory(size_t bytes, size_t &capacity);
/// Clears memory that was taken.
void clear_memory(void *data, size_t bytes);
/// One large block is kept, up to 1 GiB; the others are freed.
void give_memory_back(void *data, size_t capacity) noexcept;

}  // namespace gpurt
