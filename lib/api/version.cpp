// gpurt_version, gpurt_result_name, gpurt_last_error.
#include "api/descriptor.h"
#include "api/guard.h"

uint32_t gpurt_version(void)
{
  return uint32_t(GPURT_VERSION_MAJOR) << 16 | uint32_t(GPURT_VERSION_MINOR) << 8 |
         uint32_t(GPURT_VERSION_PATCH);
}

const char *gpurt_result_name(gpurt_result result)
{
  switch (gpurt::api::raw(result)) {
    case GPURT_OK:
      return "GPURT_OK";
    case GPURT_ERROR_INVALID_ARGUMENT:
      return "GPURT_ERROR_INVALID_ARGUMENT";
    case GPURT_ERROR_OUT_OF_MEMORY:
      return "GPURT_ERROR_OUT_OF_MEMORY";
    case GPURT_ERROR_UNSUPPORTED:
      return "GPURT_ERROR_UNSUPPORTED";
    case GPURT_ERROR_CANCELLED:
      return "GPURT_ERROR_CANCELLED";
    case GPURT_ERROR_DEVICE:
      return "GPURT_ERROR_DEVICE";
    case GPURT_ERROR_TIMEOUT:
      return "GPURT_ERROR_TIMEOUT";
    case GPURT_ERROR_IO:
      return "GPURT_ERROR_IO";
    case GPURT_ERROR_INTERNAL:
      return "GPURT_ERROR_INTERNAL";
    default:
      return "unknown result";
  }
}

const char *gpurt_last_error(void) { return gpurt::api::last_error(); }
