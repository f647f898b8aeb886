// Ray queries over kd-trees, once per instruction set.
#include "cpu/accel/block_test.h"
#include "cpu/accel/cpu_accel.h"
#include "cpu/kernels.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN

namespace {

template <TriangleTest Test, bool Masks, bool Placements>
struct Kernels {
  static const CpuKdView &view(const CpuAccel &accel) { return *static_cast<const CpuKdView *>(accel.impl); }

  static void closest(const CpuAccel &accel, const Ray *rays, Hit *hits, uint32_t n)
  {
    const CpuKdView &v = view(accel);
    for (uint32_t i = 0; i < n; ++i) hits[i] = trace_closest<Test, Masks, Placements>(v, v.scene, rays[i]);
  }
  static void occluded(const CpuAccel &accel, const Ray *rays, uint8_t *occluded, uint32_t n)
  {
    const CpuKdView &v = view(accel);
    for (uint32_t i = 0; i < n; ++i) occluded[i] = trace_any<Test, Masks, Placements>(v, v.scene, rays[i]);
  }
  static void all(const CpuAccel &accel, const Ray &ray, void *user, void (*sink)(void *, const Hit &))
  {
    const CpuKdView &v = view(accel);
    trace_all<Test, Masks, Placements>(v, v.scene, ray, [=](const Hit &hit) { sink(user, hit); });
  }
  static constexpr TraceKernels table = {closest, occluded, all};
};

template <TriangleTest Test>
struct KernelsOfTest {
  static constexpr TraceKernels table[2][2] = {
      {Kernels<Test, false, false>::table, Kernels<Test, false, true>::table},
      {Kernels<Test, true, false>::table, Kernels<Test, true, true>::table}};
};

}  // namespace

const TraceKernels &trace_kernels(TriangleTest test, bool masks, bool placements)
{
  switch (test) {
    case TriangleTest::MollerTrumbore:
      return KernelsOfTest<TriangleTest::MollerTrumbore>::table[masks][placements];
    case TriangleTest::Double:
      return KernelsOfTest<TriangleTest::Double>::table[masks][placements];
    default:
      return KernelsOfTest<TriangleTest::Watertight>::table[masks][placements];
  }
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
