// How photons are shared out among the lights of a scene.
#pragma once

#include "core/photon/emission.h"
#include "scene/compiled_scene.h"

namespace gpurt {

/// In proportion to the largest component of each light's power, in watts.
struct EmissionTable {
  std::vector<float>
      cdf;  // of lights as SceneView::lights has them, then the environment; empty: nothing shines
  double total_weight = 0;
  Vec3f center{0, 0, 0};  // of the scene's bounding sphere
  float radius = 0;

  /// Valid while this lives.
  EmissionView view() const;
};

EmissionTable make_emission_table(const CompiledScene &scene);

}  // namespace gpurt
