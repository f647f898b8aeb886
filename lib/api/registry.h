// The devices that this build and this machine have.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "backend.h"

namespace gpurt::api {

/// The CPU first, then CUDA devices by ordinal. Never fails for want of a driver.
std::vector<DeviceInfo> enumerate_devices();

/// A backend of the type; AUTO is the first CUDA device that works, else the CPU. Throws UNSUPPORTED where the build has
/// no such backend, DEVICE where the machine has no such device or it fails.
std::unique_ptr<Backend> create_backend(gpurt_device_type type, const BackendOptions &options);

/// Several devices of the type that work as one. Throws INVALID_ARGUMENT for AUTO and for an ordinal that comes twice.
std::unique_ptr<Backend> create_backend(gpurt_device_type type, const BackendOptions &options,
                                        std::span<const uint32_t> ordinals);

}  // namespace gpurt::api
