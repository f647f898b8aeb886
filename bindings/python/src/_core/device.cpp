#include <algorithm>
#include <memory>
#include <vector>

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

std::unique_ptr<Device> create(int type, uint32_t ordinal, uint32_t num_threads, uint64_t memory_limit,
                               const py::object &log)
{
  auto device = std::make_unique<Device>(CallbackId(log));
  gpurt_device_desc desc = GPURT_DEVICE_DESC_INIT;
  desc.type = static_cast<gpurt_device_type>(type);
  desc.ordinal = ordinal;
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

}  // namespace

void bind_device(py::module_ &module)
{
  module.def("devices", enumerate);
  py::class_<Device>(module, "Device")
      .def(py::init(&create), py::arg("type"), py::arg("ordinal"), py::arg("num_threads"),
           py::arg("memory_limit"), py::arg("log"))
      .def("properties", get_properties);
}

}  // namespace gpurt_python
