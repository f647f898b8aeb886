#include <pybind11/stl.h>

#include <algorithm>
#include <memory>
#include <vector>

#include "gpurt_cuda.h"
#include "objects.h"

namespace gpurt_python {

namespace {

py::dict to_dict(const gpurt_device_properties &properties)
{
  using namespace py::literals;
  return py::dict(
      "type"_a = static_cast<int>(properties.type), "ordinal"_a = properties.ordinal,
      "num_threads"_a = properties.num_threads, "memory_bytes"_a = properties.memory_bytes,
      "memory_limit"_a = properties.memory_limit_bytes, "memory_used"_a = properties.memory_used_bytes,
      "memory_peak"_a = properties.memory_peak_bytes, "compute_capability"_a = properties.compute_capability,
      "name"_a = properties.name, "instruction_set"_a = properties.instruction_set);
}

py::list enumerate()
{
  std::vector<gpurt_device_properties> found;
  uint32_t count = 0;
  call([&] { return gpurt_device_enumerate(nullptr, 0, &count); });
  // A device may come between the calls; one that goes leaves fewer.
  found.resize(count, gpurt_device_properties GPURT_DEVICE_PROPERTIES_INIT);
  const auto capacity = count;
  call([&] { return gpurt_device_enumerate(found.data(), capacity, &count); });
  py::list list;
  for (uint32_t i = 0; i < std::min(count, capacity); ++i) list.append(to_dict(found[i]));
  return list;
}

std::unique_ptr<Device> create(int type, const std::vector<uint32_t> &ordinals, uint32_t num_threads,
                               uint64_t memory_limit, const py::object &log)
{
  auto device = std::make_unique<Device>(CallbackId(log));
  gpurt_device_desc desc = GPURT_DEVICE_DESC_INIT;
  desc.type = static_cast<gpurt_device_type>(type);
  // One ordinal is passed in the plain way, which also says 0 of what has no ordinals.
  if (ordinals.size() == 1) {
    desc.ordinal = ordinals[0];
  } else {
    desc.ordinals = ordinals.data();
    desc.num_ordinals = static_cast<uint32_t>(ordinals.size());
  }
  desc.num_threads = num_threads;
  desc.memory_limit_bytes = memory_limit;
  if (device->log.is_set()) {
    desc.log = forward_log;
    desc.log_user = device->log.user();
  }
  call([&] { return gpurt_device_create(&desc, device->handle.out()); });
  return device;
}

py::dict get_properties(const Device &device)
{
  gpurt_device_properties properties = GPURT_DEVICE_PROPERTIES_INIT;
  call([&] { return gpurt_device_get_properties(device.handle.get(), &properties); });
  return to_dict(properties);
}

void order_streams(const Device &device, uint32_t ordinal, std::uintptr_t stream, std::uintptr_t after)
{
  call([&] {
    return gpurt_cuda_order(device.handle.get(), ordinal, reinterpret_cast<void *>(stream),
                            reinterpret_cast<void *>(after));
  });
}

void wait_for_stream(const Device &device, uint32_t ordinal, std::uintptr_t stream)
{
  call([&] { return gpurt_cuda_wait(device.handle.get(), ordinal, reinterpret_cast<void *>(stream)); });
}

}  // namespace

void bind_device(py::module_ &module)
{
  module.def("devices", enumerate);
  py::class_<Device>(module, "Device")
      .def(py::init(&create), py::arg("type"), py::arg("ordinals"), py::arg("num_threads"),
           py::arg("memory_limit"), py::arg("log"))
      .def("properties", get_properties)
      .def("order_streams", order_streams, py::arg("ordinal"), py::arg("stream"), py::arg("after"))
      .def("wait_for_stream", wait_for_stream, py::arg("ordinal"), py::arg("stream"));
}

}  // namespace gpurt_python
