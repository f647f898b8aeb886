#include "accel/kd_build_kernels.h"

#include <cstring>

namespace gpurt {

#if defined(GPURT_HAVE_ISA_x86_64)
inline namespace x86_64 {
extern const KdBuildKernels build_kernels;
}
#endif
#if defined(GPURT_HAVE_ISA_x86_64_v3)
namespace x86_64_v3 {
extern const KdBuildKernels build_kernels;
}
#endif
#if defined(GPURT_HAVE_ISA_generic)
inline namespace generic {
extern const KdBuildKernels build_kernels;
}
#endif

const KdBuildKernels &kd_build_kernels(const char *isa)
{
#if defined(GPURT_HAVE_ISA_x86_64_v3)
  if (std::strcmp(isa, "x86_64_v3") == 0) return x86_64_v3::build_kernels;
#endif
  (void)isa;
#if defined(GPURT_HAVE_ISA_x86_64)
  return x86_64::build_kernels;
#else
  return generic::build_kernels;
#endif
}

}  // namespace gpurt
