#include "cpu/kernels.h"

#include <cstdlib>
#include <cstring>

namespace gpurt {

#if defined(GPURT_HAVE_ISA_x86_64)
inline namespace x86_64 {
extern const KdBuildKernels build_kernels;
const TraceKernels &trace_kernels(TriangleTest test, bool masks, bool placements);
}  // namespace x86_64
#endif
#if defined(GPURT_HAVE_ISA_x86_64_v3)
namespace x86_64_v3 {
extern const KdBuildKernels build_kernels;
const TraceKernels &trace_kernels(TriangleTest test, bool masks, bool placements);
}  // namespace x86_64_v3
#endif
#if defined(GPURT_HAVE_ISA_generic)
inline namespace generic {
extern const KdBuildKernels build_kernels;
const TraceKernels &trace_kernels(TriangleTest test, bool masks, bool placements);
}  // namespace generic
#endif

namespace {

// Best last.
struct Variant {
  CpuKernels kernels;
  bool (*can_run)();
};

bool always() { return true; }
#if defined(GPURT_HAVE_ISA_x86_64_v3)
bool has_x86_64_v3()
{
  return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi") &&
         __builtin_cpu_supports("bmi2");
}
#endif

const Variant *variants(size_t &count)
{
  static const Variant list[] = {
#if defined(GPURT_HAVE_ISA_generic)
    {{"generic", generic::build_kernels, generic::trace_kernels}, always},
#endif
#if defined(GPURT_HAVE_ISA_x86_64)
    {{"x86_64", x86_64::build_kernels, x86_64::trace_kernels}, always},
#endif
#if defined(GPURT_HAVE_ISA_x86_64_v3)
    {{"x86_64_v3", x86_64_v3::build_kernels, x86_64_v3::trace_kernels}, has_x86_64_v3},
#endif
  };
  count = sizeof list / sizeof list[0];
  return list;
}

}  // namespace

const CpuKernels *cpu_kernels(const char *isa)
{
  size_t count;
  const Variant *list = variants(count);
  for (size_t i = 0; i < count; ++i) {
    if (std::strcmp(list[i].kernels.isa, isa) == 0 && list[i].can_run()) return &list[i].kernels;
  }
  return nullptr;
}

const CpuKernels &cpu_kernels()
{
  static const CpuKernels *const chosen = [] {
    if (const char *wanted = std::getenv("GPURT_ISA")) {
      if (const CpuKernels *found = cpu_kernels(wanted)) return found;
    }
    size_t count;
    const Variant *list = variants(count);
    while (!list[count - 1].can_run()) --count;
    return &list[count - 1].kernels;
  }();
  return *chosen;
}

}  // namespace gpurt
