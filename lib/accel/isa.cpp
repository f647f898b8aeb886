#include "accel/isa.h"

#include <cstdlib>
#include <cstring>

namespace gpurt {
namespace {

struct Variant {
  const char *name;
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

// Best last.
constexpr Variant variants[] = {
#if defined(GPURT_HAVE_ISA_generic)
    {"generic", always},
#endif
#if defined(GPURT_HAVE_ISA_x86_64)
    {"x86_64", always},
#endif
#if defined(GPURT_HAVE_ISA_x86_64_v3)
    {"x86_64_v3", has_x86_64_v3},
#endif
};

const char *choose()
{
  const char *wanted = std::getenv("GPURT_ISA");
  const char *best = nullptr;
  for (const Variant &v : variants) {
    if (!v.can_run()) continue;
    if (wanted != nullptr && std::strcmp(v.name, wanted) == 0) return v.name;
    best = v.name;
  }
  return best;
}

}  // namespace

const char *isa_name()
{
  static const char *const chosen = choose();
  return chosen;
}

bool can_run_isa(const char *name)
{
  for (const Variant &v : variants) {
    if (std::strcmp(v.name, name) == 0) return v.can_run();
  }
  return false;
}

}  // namespace gpurt
