// Buffers: memory of other libraries that the library reads where it is, and memory of its own for results.
#include "arrays.h"
#include "objects.h"

namespace gpurt_python {

namespace {

// The library gives memory back on any thread, and never with Python's lock.
void drop_owner(void *user, void *) { drop_object(static_cast<PyObject *>(user)); }

// data 0: memory of the library. Otherwise `owner` is kept until the last reader of the memory has gone.
std::unique_ptr<Buffer> create(const Device &device, bool in_device_memory, uint64_t size_bytes,
                               std::uintptr_t data, const py::object &owner)
{
  auto buffer = std::make_unique<Buffer>();
  gpurt_buffer_desc desc = GPURT_BUFFER_DESC_INIT;
  desc.storage = in_device_memory ? GPURT_STORAGE_DEVICE : GPURT_STORAGE_HOST;
  desc.size_bytes = size_bytes;
  desc.data = reinterpret_cast<void *>(data);
  if (data != 0) {
    desc.release = drop_owner;
    desc.release_user = owner.ptr();
  }
  call([&] { return gpurt_buffer_create(device.handle.get(), &desc, buffer->handle.out()); });
  if (data != 0) py::object(owner).release();  // now the buffer's
  return buffer;
}

std::uintptr_t get_data(const Buffer &buffer)
{
  void *data = nullptr;
  uint64_t size_bytes = 0;
  call([&] { return gpurt_buffer_get_data(buffer.handle.get(), &data, &size_bytes); });
  return reinterpret_cast<std::uintptr_t>(data);
}

py::bytes read(const Buffer &buffer, uint64_t offset_bytes, uint64_t size_bytes)
{
  std::string bytes(size_bytes, '\0');
  call([&] { return gpurt_buffer_read(buffer.handle.get(), offset_bytes, bytes.data(), size_bytes); });
  return bytes;
}

}  // namespace

gpurt_array buffer_array(const py::tuple &rows, const char *name)
{
  if (rows.size() != 4) raise_invalid(std::string(name) + ": expected (buffer, offset, stride, count)");
  gpurt_array array = {};
  array.buffer = rows[0].cast<const Buffer &>().handle.get();
  array.offset_bytes = rows[1].cast<uint64_t>();
  array.stride_bytes = rows[2].cast<uint64_t>();
  array.count = rows[3].cast<uint64_t>();
  return array;
}

void bind_buffer(py::module_ &module)
{
  py::class_<Buffer>(module, "Buffer")
      .def(py::init(&create), py::arg("device"), py::arg("in_device_memory"), py::arg("size_bytes"),
           py::arg("data"), py::arg("owner"))
      .def("data", get_data)
      .def("read", read, py::arg("offset_bytes"), py::arg("size_bytes"));
}

}  // namespace gpurt_python
