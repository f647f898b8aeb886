// What a texture emits over the triangles of a lamp.
#pragma once

#include <vector>

#include "core/scene/scene_view.h"

namespace gpurt {

/// Means of a texture over triangles. They decide how often a lamp is drawn, never what it emits: near the triangle's edges
/// and where a triangle covers many texels they are as coarse as the work is bounded, but a channel is 0 only where no
/// lookup on the triangle finds more.
class LampTexture {
 public:
  /// Refers to the texels while the means are asked for.
  explicit LampTexture(const Texture &texture);

  /// Over the triangle with these texture coordinates.
  Vec3f mean(const Vec2f (&uv)[3]) const;

 private:
  struct Level {
    uint32_t width, height;
    std::vector<Vec3f> texels;
  };
  Vec3f texel(uint32_t level, uint32_t x, uint32_t y) const;
  uint32_t num_levels() const { return uint32_t(coarser_.size()) + 1; }

  Texture texture_;
  std::vector<Level> coarser_;  // each half as wide and high as the one before, down to one texel
};

}  // namespace gpurt
