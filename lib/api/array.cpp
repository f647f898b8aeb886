#include "api/array.h"

#include <cstring>

namespace gpurt::api {
namespace {

// Elements are counted in 32 bits everywhere, with one value left for "none".
constexpr uint64_t max_count = invalid_id - 1;

// Bytes from the first element's first to the last element's last; throws where 64 bits cannot tell.
uint64_t extent_bytes(uint64_t count, uint64_t stride, uint64_t element_bytes, const char *name)
{
  if (count == 0) return 0;
  if (count > max_count)
    fail_invalid("{}: count is {}; an array has at most {} elements", name, count, max_count);
  uint64_t last;
  if (__builtin_mul_overflow(count - 1, stride, &last) ||
      __builtin_add_overflow(last, element_bytes, &last)) {
    fail_invalid("{}: {} elements with a stride of {} bytes are more than memory can hold", name, count,
                 stride);
  }
  return last;
}

}  // namespace

ArrayPlace locate(const gpurt_array &array, uint64_t element_bytes, const char *name, const Device &device)
{
  if (array.data && array.buffer) fail_invalid("{}: both data and buffer are given; give one of them", name);
  if (!is_given(array) && array.count != 0) {
    fail_invalid("{}: count is {}, but neither data nor buffer is given", name, array.count);
  }
  ArrayPlace place;
  place.stride_bytes = array.stride_bytes != 0 ? array.stride_bytes : element_bytes;
  if (place.stride_bytes < element_bytes) {
    fail_invalid("{}: stride_bytes is {}, but an element has {} bytes", name, array.stride_bytes,
                 element_bytes);
  }
  const uint64_t extent = extent_bytes(array.count, place.stride_bytes, element_bytes, name);
  if (array.buffer) {
    place.buffer = get(array.buffer, name);
    if (place.buffer->device.get() != &device) {
      fail_invalid("{}: the buffer belongs to another device; create one on the device of the scene", name);
    }
    const uint64_t size = place.buffer->size_bytes;
    if (array.offset_bytes > size || extent > size - array.offset_bytes) {
      fail_invalid("{}: {} elements from byte {} on need {} bytes, but the buffer has only {} after it", name,
                   array.count, array.offset_bytes, extent, size - std::min(size, array.offset_bytes));
    }
    place.first = static_cast<const std::byte *>(place.buffer->data) + array.offset_bytes;
  } else if (array.data) {
    uint64_t last;
    if (__builtin_add_overflow(reinterpret_cast<uintptr_t>(array.data), array.offset_bytes, &last) ||
        __builtin_add_overflow(last, extent, &last)) {
      fail_invalid("{}: offset_bytes {} and {} elements reach past the end of memory", name,
                   array.offset_bytes, array.count);
    }
    place.first = static_cast<const std::byte *>(array.data) + array.offset_bytes;
  }
  return place;
}

void copy_elements(const ArrayPlace &place, uint64_t count, uint64_t element_bytes, void *packed,
                   const Device &device)
{
  if (count == 0) return;
  const std::byte *from = place.first;
  std::vector<std::byte> staged;
  if (place.buffer && !place.buffer->is_host()) {
    const uint64_t extent = (count - 1) * place.stride_bytes + element_bytes;
    if (place.stride_bytes == element_bytes) return device.backend->copy_to_host(packed, from, extent);
    staged.resize(extent);
    device.backend->copy_to_host(staged.data(), from, extent);
    from = staged.data();
  }
  if (place.stride_bytes == element_bytes) {
    std::memcpy(packed, from, count * element_bytes);
    return;
  }
  auto *to = static_cast<std::byte *>(packed);
  for (uint64_t i = 0; i < count; ++i) {
    std::memcpy(to + i * element_bytes, from + i * place.stride_bytes, element_bytes);
  }
}

}  // namespace gpurt::api
