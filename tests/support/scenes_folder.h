// Where image tests find the scenes that lie beside the checkout, and the device that they render on.
#pragma once

#include <cstdlib>
#include <filesystem>

#include "gpurt_test.h"

namespace gpurt_test {

/// GPURT_TEST_SCENES, or ../shared/scenes from the source folder: it need not be there.
inline std::filesystem::path scenes_folder()
{
  const char *folder = std::getenv("GPURT_TEST_SCENES");
  if (folder != nullptr) return folder;
  return std::filesystem::path(GPURT_SOURCE_DIR).parent_path() / "shared" / "scenes";
}

/// What GPURT_TEST_DEVICE says, cpu or cuda; else the CPU.
inline gpurt_device_type image_device_type()
{
  const char *device = std::getenv("GPURT_TEST_DEVICE");
  if (device == nullptr || std::string(device) == "cpu") return GPURT_DEVICE_CPU;
  EXPECT_EQ(std::string(device), "cuda") << "GPURT_TEST_DEVICE is neither cpu nor cuda";
  return GPURT_DEVICE_CUDA;
}

}  // namespace gpurt_test
