// Picks the variant of a query kernel for a scene: its tree, its triangle test, and whether it has alpha masks and
// placements.
#pragma once

#include "cuda/accel/kernels.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

template <bool BvhValue, TriangleTest TestValue, bool MasksValue, bool PlacementsValue>
struct TraceVariant {
  static constexpr TriangleTest test = TestValue;
  static constexpr bool masks = MasksValue;
  static constexpr bool placements = PlacementsValue;
  // Blocks of a multiprocessor that registers must leave room for. Measuring an accepted hit in double would take so many
  // that half as many rays could be in flight; they are saved around it instead.
  static constexpr int min_blocks = BvhValue ? 8 : 1;

  static GPURT_INLINE const auto &accel(const TraceScene &scene)
  {
    if constexpr (BvhValue) return scene.bvhs;
    else return scene.kd_trees;
  }
};

template <bool Bvh, TriangleTest Test, class Fn>
void dispatch_scene(const TraceScene &scene, Fn &&fn)
{
  if (scene.scene.has_alpha_masks) {
    if (scene.scene.num_placements != 0) fn(TraceVariant<Bvh, Test, true, true>{});
    else fn(TraceVariant<Bvh, Test, true, false>{});
  } else {
    if (scene.scene.num_placements != 0) fn(TraceVariant<Bvh, Test, false, true>{});
    else fn(TraceVariant<Bvh, Test, false, false>{});
  }
}

template <bool Bvh, class Fn>
void dispatch_test(const TraceScene &scene, Fn &&fn)
{
  switch (scene.triangle_test) {
    case TriangleTest::Watertight:
      return dispatch_scene<Bvh, TriangleTest::Watertight>(scene, fn);
    case TriangleTest::MollerTrumbore:
      return dispatch_scene<Bvh, TriangleTest::MollerTrumbore>(scene, fn);
    case TriangleTest::Double:
      return dispatch_scene<Bvh, TriangleTest::Double>(scene, fn);
  }
}

// Kernels that count lanes have one triangle test, and both of masks and placements or neither.
template <class Fn>
void dispatch_counting(const TraceScene &scene, Fn &&fn)
{
  constexpr TriangleTest test = TriangleTest::Watertight;
  const bool everything = scene.scene.has_alpha_masks || scene.scene.num_placements != 0;
  if (scene.has_bvhs) {
    if (everything) fn(TraceVariant<true, test, true, true>{});
    else fn(TraceVariant<true, test, false, false>{});
  } else {
    if (everything) fn(TraceVariant<false, test, true, true>{});
    else fn(TraceVariant<false, test, false, false>{});
  }
}

/// Calls fn(TraceVariant<...>{}) with what fits the scene.
template <class Fn>
void dispatch(const TraceScene &scene, Fn &&fn)
{
  if constexpr (counts_lanes) dispatch_counting(scene, fn);
  else if (scene.has_bvhs) dispatch_test<true>(scene, fn);
  else dispatch_test<false>(scene, fn);
}

GPURT_KERNELS_END
}  // namespace gpurt::cuda
