// gpurt_device_*: enumerate, create, properties.
#include "api/descriptor.h"
#include "api/guard.h"
#include "api/objects.h"
#include "api/registry.h"

namespace gpurt::api {

void Log::operator()(gpurt_log_level level, const std::string &message)
{
  if (!function_) return;
  const std::scoped_lock lock(mutex_);
  try {
    function_(user_, level, message.c_str());
  } catch (...) {
    // A C++ caller's exception has nobody to go to here: what is logged may come from a worker thread.
  }
}

namespace {

// More threads than any machine has processors; a larger number is a mistake that would exhaust the system.
constexpr uint32_t max_threads = 4096;
// More devices than any machine has.
constexpr uint32_t max_ordinals = 1024;

template <size_t n>
void copy_text(char (&to)[n], const std::string &from)
{
  to[from.copy(to, n - 1)] = 0;
}

gpurt_device_properties describe(const DeviceInfo &info)
{
  gpurt_device_properties properties = GPURT_DEVICE_PROPERTIES_INIT;
  properties.type = info.type;
  properties.ordinal = info.ordinal;
  properties.num_threads = info.num_threads;
  properties.memory_bytes = info.memory_bytes;
  properties.compute_capability = info.compute_capability;
  copy_text(properties.name, info.name);
  copy_text(properties.instruction_set, info.instruction_set);
  return properties;
}

}  // namespace
}  // namespace gpurt::api

using namespace gpurt;
using namespace gpurt::api;

gpurt_result gpurt_device_enumerate(gpurt_device_properties *devices, uint32_t capacity, uint32_t *out_count)
{
  return guard([&] {
    require(out_count, "out_count");
    const std::vector<DeviceInfo> infos = enumerate_devices();
    if (devices && capacity != 0) {
      // The caller's struct may have another size than ours: its own struct_size is the distance between elements.
      constexpr const StructInfo &info = StructTraits<gpurt_device_properties>::info;
      const uint32_t stride = checked_struct_size(devices, info, "devices[0]");
      auto *const first = reinterpret_cast<std::byte *>(devices);
      const uint32_t n = uint32_t(std::min<size_t>(capacity, infos.size()));
      for (uint32_t i = 1; i < n; ++i) {
        if (checked_struct_size(first + uint64_t(i) * stride, info, "devices") != stride) {
          fail_invalid("devices[{}]: struct_size is not that of devices[0], {}; set it in every element", i,
                       stride);
        }
      }
      for (uint32_t i = 0; i < n; ++i) {
        const gpurt_device_properties properties = describe(infos[i]);
        write_struct(first + uint64_t(i) * stride, &properties, info, "devices");
      }
    }
    *out_count = uint32_t(infos.size());
  });
}

gpurt_result gpurt_device_create(const gpurt_device_desc *desc, gpurt_device *out_device)
{
  return guard([&] {
    require(out_device, "out_device");
    const gpurt_device_desc d = read_optional_descriptor(desc);
    check_enum(d.type, GPURT_DEVICE_CUDA + 1, "type", "gpurt_device_type");
    check_reserved(d.reserved, "reserved");
    if (d.num_threads > max_threads)
      fail_invalid("num_threads is {}; at most {}", d.num_threads, max_threads);
    if (d.ordinals && d.num_ordinals == 0) fail_invalid("ordinals are given, but num_ordinals is 0");
    if (!d.ordinals && d.num_ordinals != 0)
      fail_invalid("ordinals is NULL, but num_ordinals is {}", d.num_ordinals);
    if (d.num_ordinals > max_ordinals)
      fail_invalid("num_ordinals is {}; at most {}", d.num_ordinals, max_ordinals);
    if (d.ordinals && d.ordinal != 0)
      fail_invalid("ordinal is {}, but ordinals are given too; put it among them", d.ordinal);

    auto device = std::make_shared<Device>();
    device->log = std::make_shared<Log>(d.log, d.log_user);
    BackendOptions options;
    options.ordinal = d.ordinal;
    options.num_threads = d.num_threads;
    options.memory_limit_bytes = d.memory_limit_bytes;
    options.log = [log = device->log](gpurt_log_level level, const std::string &message) {
      (*log)(level, message);
    };
    device->backend = d.ordinals ? create_backend(d.type, options, {d.ordinals, d.num_ordinals})
                                 : create_backend(d.type, options);
    *out_device = publish<gpurt_device>(std::move(device));
  });
}

gpurt_result gpurt_device_retain(gpurt_device device)
{
  return guard([&] { retain(device, "device"); });
}

gpurt_result gpurt_device_release(gpurt_device device)
{
  return guard([&] { release(device, "device"); });
}

gpurt_result gpurt_device_get_properties(gpurt_device device, gpurt_device_properties *out_properties)
{
  return guard([&] {
    const auto object = get(device, "device");
    check_output(out_properties, "out_properties");
    gpurt_device_properties properties = describe(object->info());
    const MemoryTracker &memory = *object->memory();
    properties.memory_limit_bytes = memory.limit();
    properties.memory_used_bytes = memory.used();
    properties.memory_peak_bytes = memory.peak();
    write_output(out_properties, properties, "out_properties");
  });
}
