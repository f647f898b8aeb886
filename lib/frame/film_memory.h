// Memory of films, kept for the next film.
#pragma once

#include <cstddef>

namespace gpurt {

/// At least `bytes`, aligned for any type; `capacity` is what there is. Large blocks may be what the last film had: pages that the
/// system maps anew cost ten times as much to clear. Throws std::bad_alloc.
void *take_memory(size_t bytes, size_t &capacity);
/// Large blocks are cleared by all threads.
void clear_memory(void *data, size_t bytes);
/// One large block is kept, up to 1 GiB; the others are freed.
void give_memory_back(void *data, size_t capacity) noexcept;

}  // namespace gpurt
