#include "accel/isa.h"

#include <cstdlib>
#include <cstring>

namespace gpurt {
namespace {

struct Variant {
  const char *name;
  bool (*can_run)();
  bool is_wide;  // some kernels have it
};

bool always() { return true; }
#if defined(GPURT_HAVE_ISA_x86_64_v3)
bool has_x86_64_v3()
{
  return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi") &&
         __builtin_cpu_supports("bmi2");
}
#endif
#if defined(GPURT_HAVE_ISA_x86_64_v4)
bool has_x86_64_v4()
{
  return has_x86_64_v3() && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
         __builtin_cpu_supports("avx512cd") && __builtin_cpu_supports("avx512dq") &&
         __builtin_cpu_supports("avx512vl");
}
#endif

// Best last.
constexpr Variant variants[] = {
#if defined(GPURT_HAVE_ISA_generic)
    {"generic", always, false},
#endif
#if defined(GPURT_HAVE_ISA_x86_64)
    {"x86_64", always, false},
#endif
#if defined(GPURT_HAVE_ISA_x86_64_v3)
    {"x86_64_v3", has_x86_64_v3, false},
#endif
#if defined(GPURT_HAVE_ISA_x86_64_v4)
    {"x86_64_v4", has_x86_64_v4, true},
#endif
};

// `wide`: of all variants, else of those that all kernels have.
const char *choose(bool wide)
{
  const char *wanted = std::getenv("GPURT_ISA");
  const char *best = nullptr;
  for (const Variant &v : variants) {
    if (!v.can_run() || (v.is_wide && !wide)) continue;
    best = v.name;
    if (wanted != nullptr && std::strcmp(v.name, wanted) == 0) break;
  }
  return best;
}

}  // namespace

const char *isa_name()
{
  static const char *const chosen = choose(false);
  return chosen;
}

const char *wide_isa_name() { return choose(true); }

bool can_run_isa(const char *name)
{
  for (const Variant &v : variants) {
    if (std::strcmp(v.name, name) == 0) return v.can_run();
  }
  return false;
}

}  // namespace gpurt
