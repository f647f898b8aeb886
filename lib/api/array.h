// Reading of gpurt_array: a copy of host memory, or a part of a shared buffer.
#pragma once

#include "api/objects.h"

namespace gpurt::api {

/// An array whose bytes are counted against the device's memory limit for as long as anybody refers to it.
template <class T>
struct CountedArray {
  Reservation reservation;
  std::vector<T> values;
};

/// count values, zero. Throws OUT_OF_MEMORY.
template <class T>
std::shared_ptr<CountedArray<T>> make_counted_array(const Device &device, uint64_t count, const char *what)
{
  auto array = std::make_shared<CountedArray<T>>();
  array->reservation = Reservation(device.memory(), count * sizeof(T), what);
  try {
    array->values.resize(count);
  } catch (const std::exception &) {
    fail(GPURT_ERROR_OUT_OF_MEMORY, "{} needs {} bytes, which the system does not have", what,
         count * sizeof(T));
  }
  return array;
}

inline bool is_given(const gpurt_array &array) { return array.data || array.buffer; }

/// Where the elements of an array lie, checked: nothing outside of memory that the caller named is touched.
struct ArrayPlace {
  std::shared_ptr<Buffer> buffer;  // null: host memory to copy from
  const std::byte *first = nullptr;
  uint64_t stride_bytes = 0;
  bool is_shared() const { return buffer && buffer->is_host(); }
};

/// Throws INVALID_ARGUMENT for ranges that do not fit, with the name of the array.
ArrayPlace locate(const gpurt_array &array, uint64_t element_bytes, const char *name, const Device &device);

/// Copies elements from where they lie into packed host memory.
void copy_elements(const ArrayPlace &place, uint64_t count, uint64_t element_bytes, void *packed,
                   const Device &device);

/// Reads an array; an array that is not given is empty. `is_shared` is set to true where the result refers to the
/// caller's buffer, and left alone otherwise.
template <class T>
SharedArray<T> read_array(const gpurt_array &array, const char *name, const Device &device, bool *is_shared)
{
  const ArrayPlace place = locate(array, sizeof(T), name, device);
  if (array.count == 0) return {};
  if (place.is_shared()) {
    *is_shared = true;
    return SharedArray<T>(place.buffer, place.first, array.count, place.stride_bytes);
  }
  auto copy = make_counted_array<T>(device, array.count, name);
  copy_elements(place, array.count, sizeof(T), copy->values.data(), device);
  return SharedArray<T>(copy, copy->values.data(), array.count, sizeof(T));
}

}  // namespace gpurt::api
