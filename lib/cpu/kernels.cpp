#include "cpu/kernels.h"

#include <cstring>

#include "accel/isa.h"

namespace gpurt {

#if defined(GPURT_HAVE_ISA_x86_64)
inline namespace x86_64 {
const TraceKernels &trace_kernels(TriangleTest test, bool masks, bool placements);
const TraceKernels &bvh_kernels(TriangleTest test, bool masks, bool placements);
}  // namespace x86_64
#endif
#if defined(GPURT_HAVE_ISA_x86_64_v3)
namespace x86_64_v3 {
const TraceKernels &trace_kernels(TriangleTest test, bool masks, bool placements);
const TraceKernels &bvh_kernels(TriangleTest test, bool masks, bool placements);
}  // namespace x86_64_v3
#endif
#if defined(GPURT_HAVE_ISA_generic)
inline namespace generic {
const TraceKernels &trace_kernels(TriangleTest test, bool masks, bool placements);
const TraceKernels &bvh_kernels(TriangleTest test, bool masks, bool placements);
}  // namespace generic
#endif

const CpuKernels *cpu_kernels(const char *isa)
{
  static const CpuKernels variants[] = {
#if defined(GPURT_HAVE_ISA_generic)
      {"generic", generic::trace_kernels, generic::bvh_kernels},
#endif
#if defined(GPURT_HAVE_ISA_x86_64)
      {"x86_64", x86_64::trace_kernels, x86_64::bvh_kernels},
#endif
#if defined(GPURT_HAVE_ISA_x86_64_v3)
      {"x86_64_v3", x86_64_v3::trace_kernels, x86_64_v3::bvh_kernels},
#endif
  };
  for (const CpuKernels &k : variants) {
    if (std::strcmp(k.isa, isa) == 0 && can_run_isa(isa)) return &k;
  }
  return nullptr;
}

const CpuKernels &cpu_kernels() { return *cpu_kernels(isa_name()); }

}  // namespace gpurt
