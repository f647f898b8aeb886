// gpurt_cuda_order and gpurt_cuda_wait: the caller's streams.
#include "api/guard.h"
#include "api/objects.h"
#include "gpurt_cuda.h"

namespace gpurt::api {
namespace {

StreamOrdering &streams_of(const Device &device)
{
  auto *const ordering = dynamic_cast<StreamOrdering *>(device.backend.get());
  if (!ordering) fail(GPURT_ERROR_UNSUPPORTED, "the device is the CPU, which has no streams");
  return *ordering;
}

}  // namespace
}  // namespace gpurt::api

using namespace gpurt;
using namespace gpurt::api;

gpurt_result gpurt_cuda_order(gpurt_device device, uint32_t ordinal, void *stream, void *after)
{
  return guard([&] {
    const auto object = get(device, "device");
    streams_of(*object).order_streams(ordinal, stream, after);
  });
}

gpurt_result gpurt_cuda_wait(gpurt_device device, uint32_t ordinal, void *stream)
{
  return guard([&] {
    const auto object = get(device, "device");
    streams_of(*object).wait_for_stream(ordinal, stream);
  });
}
