// The only file that names the backends.
#include "api/registry.h"

#include <algorithm>

#include "cpu/factory.h"
#if defined(GPURT_HAVE_CUDA)
#include "cuda/factory.h"
#endif
#include "multi/multi_backend.h"

namespace gpurt::api {
namespace {

std::vector<const BackendFactory *> factories()
{
  return {
      &cpu::factory(),
#if defined(GPURT_HAVE_CUDA)
      &cuda::factory(),
#endif
  };
}

const BackendFactory *find_factory(gpurt_device_type type)
{
  for (const BackendFactory *factory : factories()) {
    if (factory->type == type) return factory;
  }
  return nullptr;
}

const char *type_name(gpurt_device_type type) { return type == GPURT_DEVICE_CUDA ? "CUDA" : "CPU"; }

std::unique_ptr<Backend> create_automatic(const BackendOptions &options)
{
  if (options.ordinal != 0) {
    fail_invalid("ordinal is {}, but type is GPURT_DEVICE_AUTO; name the type that the ordinal counts in",
                 options.ordinal);
  }
  if (const BackendFactory *cuda = find_factory(GPURT_DEVICE_CUDA)) {
    for (const DeviceInfo &info : cuda->enumerate()) {
      BackendOptions with_ordinal = options;
      with_ordinal.ordinal = info.ordinal;
      try {
        return cuda->create(with_ordinal);
      } catch (const Error &e) {
        if (options.log) {
          options.log(GPURT_LOG_WARNING,
                      fmt::format("CUDA device {} is passed over: {}", info.ordinal, e.what()));
        }
      }
    }
  }
  return cpu::factory().create(options);
}

}  // namespace

std::vector<DeviceInfo> enumerate_devices()
{
  std::vector<DeviceInfo> devices;
  for (const BackendFactory *factory : factories()) {
    for (DeviceInfo &info : factory->enumerate()) devices.push_back(std::move(info));
  }
  return devices;
}

std::unique_ptr<Backend> create_backend(gpurt_device_type type, const BackendOptions &options)
{
  if (type == GPURT_DEVICE_AUTO) return create_automatic(options);
  const BackendFactory *factory = find_factory(type);
  if (!factory) {
    fail(GPURT_ERROR_UNSUPPORTED, "this build has no {} backend; use the CPU, or a build with GPURT_CUDA=ON",
         type_name(type));
  }
  const std::vector<DeviceInfo> devices = factory->enumerate();
  for (const DeviceInfo &info : devices) {
    if (info.ordinal == options.ordinal) return factory->create(options);
  }
  fail(GPURT_ERROR_DEVICE, "there is no {} device {}; this machine has {} that can be used", type_name(type),
       options.ordinal, devices.size());
}

std::unique_ptr<Backend> create_backend(gpurt_device_type type, const BackendOptions &options,
                                        std::span<const uint32_t> ordinals)
{
  if (type == GPURT_DEVICE_AUTO) {
    fail_invalid("ordinals are given, but type is GPURT_DEVICE_AUTO; name the type that they count in");
  }
  std::vector<std::unique_ptr<Backend>> backends;
  for (size_t i = 0; i < ordinals.size(); ++i) {
    if (std::find(ordinals.begin(), ordinals.begin() + i, ordinals[i]) != ordinals.begin() + i)
      fail_invalid("ordinals[{}] is {}, which comes before; name every device once", i, ordinals[i]);
    BackendOptions one = options;
    one.ordinal = ordinals[i];
    backends.push_back(create_backend(type, one));
  }
  if (backends.size() == 1) return std::move(backends[0]);
  return multi::join(std::move(backends));
}

}  // namespace gpurt::api
