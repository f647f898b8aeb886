// The library's version, from the build.
#include "gpurt.h"

uint32_t gpurt_version(void)
{
  return GPURT_VERSION_MAJOR << 16 | GPURT_VERSION_MINOR << 8 | GPURT_VERSION_PATCH;
}
