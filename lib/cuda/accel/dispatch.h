// Picks the variant of a query kernel for a scene: its triangle test, and whether it has alpha masks and placements.
#pragma once

#include "cuda/accel/kernels.h"

namespace gpurt::cuda {

template <TriangleTest TestValue, bool MasksValue, bool PlacementsValue>
struct TraceVariant {
  static constexpr TriangleTest test = TestValue;
  static constexpr bool masks = MasksValue;
  static constexpr bool placements = PlacementsValue;
};

template <TriangleTest Test, class Fn>
void dispatch_scene(const TraceScene &scene, Fn &&fn)
{
  if (scene.scene.has_alpha_masks) {
    if (scene.scene.num_placements != 0) fn(TraceVariant<Test, true, true>{});
    else fn(TraceVariant<Test, true, false>{});
  } else {
    if (scene.scene.num_placements != 0) fn(TraceVariant<Test, false, true>{});
    else fn(TraceVariant<Test, false, false>{});
  }
}

/// Calls fn(TraceVariant<...>{}) with what fits the scene.
template <class Fn>
void dispatch(const TraceScene &scene, Fn &&fn)
{
  switch (scene.triangle_test) {
    case TriangleTest::Watertight:
      return dispatch_scene<TriangleTest::Watertight>(scene, fn);
    case TriangleTest::MollerTrumbore:
      return dispatch_scene<TriangleTest::MollerTrumbore>(scene, fn);
    case TriangleTest::Double:
      return dispatch_scene<TriangleTest::Double>(scene, fn);
  }
}

}  // namespace gpurt::cuda
