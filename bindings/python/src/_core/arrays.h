// numpy arrays as the memory that the C library reads and writes.
#pragma once

#include <pybind11/numpy.h>

#include <array>
#include <cstdint>

#include "call.h"
#include "gpurt.h"

namespace gpurt_python {

/// A path from os.fsencode() as the C library takes it.
inline std::string to_path(const py::bytes &path)
{
  std::string text = path;
  if (text.find('\0') != std::string::npos) raise_invalid("path: contains a null character");
  return text;
}

/// Rows in a buffer: (Buffer, offset in bytes, distance of rows in bytes, number of rows).
gpurt_array buffer_array(const py::tuple &rows, const char *name);

/// A two-dimensional array of T, rows in a buffer, or None, as a gpurt_array. Rows may be apart from each other, within a row
/// everything is packed: the package has copied what is laid out otherwise.
template <class T>
gpurt_array to_gpurt_array(const py::object &object, py::ssize_t columns, const char *name)
{
  gpurt_array array = {};
  if (object.is_none()) return array;
  if (py::isinstance<py::tuple>(object)) return buffer_array(object, name);
  constexpr auto item = static_cast<py::ssize_t>(sizeof(T));
  if (!py::isinstance<py::array_t<T>>(object)) raise_invalid(std::string(name) + ": wrong type of array");
  const auto source = py::reinterpret_borrow<py::array>(object);
  if (source.ndim() != 2 || source.shape(1) != columns ||
      (source.shape(0) > 1 && source.strides(0) < columns * item) ||
      (source.shape(0) > 0 && columns > 1 && source.strides(1) != item)) {
    raise_invalid(std::string(name) + ": wrong shape or strides");
  }
  array.data = source.data();
  array.count = static_cast<uint64_t>(source.shape(0));
  array.stride_bytes = source.shape(0) > 1 ? static_cast<uint64_t>(source.strides(0)) : 0;
  return array;
}

/// The memory of a packed array of `size_bytes`; None gives NULL.
inline const void *packed_data(const py::object &object, uint64_t size_bytes, const char *name)
{
  if (object.is_none()) return nullptr;
  const auto array = py::reinterpret_borrow<py::array>(object);
  if (!py::isinstance<py::array>(object) || !(array.flags() & py::array::c_style) ||
      static_cast<uint64_t>(array.nbytes()) != size_bytes) {
    raise_invalid(std::string(name) + ": not a packed array of the right size");
  }
  return array.data();
}

inline void *packed_output(const py::object &object, uint64_t size_bytes, const char *name)
{
  const void *data = packed_data(object, size_bytes, name);
  if (data && !py::reinterpret_borrow<py::array>(object).writeable()) {
    raise_invalid(std::string(name) + ": cannot be written to");
  }
  return const_cast<void *>(data);
}

template <std::size_t N>
void copy_floats(const std::array<float, N> &from, float (&to)[N])
{
  for (std::size_t i = 0; i < N; ++i) to[i] = from[i];
}

template <std::size_t N>
py::tuple to_tuple(const float (&values)[N])
{
  py::tuple tuple(N);
  for (std::size_t i = 0; i < N; ++i) tuple[i] = values[i];
  return tuple;
}

}  // namespace gpurt_python
