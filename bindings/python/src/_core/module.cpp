// gpurt._core: the C library's handles, calls and arrays for the package gpurt, which alone uses it.

#include <pybind11/pybind11.h>

#include "dlpack.h"
#include "objects.h"

namespace {

std::string version_text()
{
  const uint32_t version = gpurt_version();
  return std::to_string(version >> 16) + "." + std::to_string(version >> 8 & 0xff) + "." +
         std::to_string(version & 0xff);
}

}  // namespace

PYBIND11_MODULE(_core, module)
{
  using namespace gpurt_python;
  module.doc() = "Private: use the package gpurt.";
  module.def("version", version_text);
  module.def("stop", [] {
    stop_callbacks();
    stop_jobs();
    wait_for_calls();
  });
  bind_device(module);
  bind_dlpack(module);
  bind_buffer(module);
  bind_scene(module);
  bind_photons(module);
  bind_frame(module);
}
