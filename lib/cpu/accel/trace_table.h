// Makes the kernels of kernel_table.h for a view of a tree. For files that are compiled once per instruction set.
#pragma once

#include "cpu/accel/block_test.h"
#include "cpu/accel/cpu_accel.h"
#include "cpu/accel/kernel_table.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN

template <class View, TriangleTest Test, bool Masks, bool Placements>
struct Kernels {
  static const View &view(const CpuAccel &accel) { return *static_cast<const View *>(accel.impl); }

  static void closest(const CpuAccel &accel, const Ray *rays, Hit *hits, uint32_t n)
  {
    const View &v = view(accel);
    for (uint32_t i = 0; i < n; ++i) hits[i] = trace_closest<Test, Masks, Placements>(v, v.scene, rays[i]);
  }
  static void occluded(const CpuAccel &accel, const Ray *rays, uint8_t *occluded, uint32_t n)
  {
    const View &v = view(accel);
    for (uint32_t i = 0; i < n; ++i) occluded[i] = trace_any<Test, Masks, Placements>(v, v.scene, rays[i]);
  }
  static void all(const CpuAccel &accel, const Ray &ray, void *user, void (*sink)(void *, const Hit &))
  {
    const View &v = view(accel);
    trace_all<Test, Masks, Placements>(v, v.scene, ray, [=](const Hit &hit) { sink(user, hit); });
  }
  static constexpr TraceKernels table = {closest, occluded, all};
};

template <class View, TriangleTest Test>
struct KernelsOfTest {
  static constexpr TraceKernels table[2][2] = {
      {Kernels<View, Test, false, false>::table, Kernels<View, Test, false, true>::table},
      {Kernels<View, Test, true, false>::table, Kernels<View, Test, true, true>::table}};
};

template <class View>
const TraceKernels &kernels_of(TriangleTest test, bool masks, bool placements)
{
  switch (test) {
    case TriangleTest::MollerTrumbore:
      return KernelsOfTest<View, TriangleTest::MollerTrumbore>::table[masks][placements];
    case TriangleTest::Double:
      return KernelsOfTest<View, TriangleTest::Double>::table[masks][placements];
    default:
      return KernelsOfTest<View, TriangleTest::Watertight>::table[masks][placements];
  }
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
