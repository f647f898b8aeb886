#include "cpu/photon/gather_table.h"

#include <cstring>

#include "accel/isa.h"

namespace gpurt {

#if defined(GPURT_HAVE_ISA_x86_64)
inline namespace x86_64 {
const GatherKernels &gather_kernels_of_isa();
}  // namespace x86_64
#endif
#if defined(GPURT_HAVE_ISA_x86_64_v3)
namespace x86_64_v3 {
const GatherKernels &gather_kernels_of_isa();
}  // namespace x86_64_v3
#endif
#if defined(GPURT_HAVE_ISA_generic)
inline namespace generic {
const GatherKernels &gather_kernels_of_isa();
}  // namespace generic
#endif

const GatherKernels &gather_kernels()
{
#if defined(GPURT_HAVE_ISA_x86_64_v3)
  if (std::strcmp(isa_name(), "x86_64_v3") == 0) return x86_64_v3::gather_kernels_of_isa();
#endif
  return gather_kernels_of_isa();
}

}  // namespace gpurt
