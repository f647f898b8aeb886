// The library's version, from the build.
#include "gpurt.h"

uint32_t gpurt_version(void)
{
  return 0u << 16 | 1u << 8 | 0u;
}
