// Images made by code, as PNG bytes for a .glb.
#pragma once

#include <functional>
#include <vector>

#include "mesh.h"

namespace cli::scenes {

/// Linear colour and opacity, each in [0, 1].
struct Texel {
  Vec3 color;
  double alpha = 1;
};

/// 8-bit sRGB PNG of what `texel` says at texel centres, (0, 0) being the top left corner, (1, 1) the bottom right one.
std::vector<uint8_t> make_png(int width, int height, bool has_alpha,
                              const std::function<Texel(double u, double v)> &texel);

/// Wooden planks, two metres by two metres, that repeat.
std::vector<uint8_t> wood_planks(int size);
/// Bark that repeats around and along.
std::vector<uint8_t> bark(int size);
/// A twig with leaves, of a broad-leaved tree; stands on the bottom edge's middle.
std::vector<uint8_t> leaf_twig(int size);
/// A twig with needles, from the left edge to the right.
std::vector<uint8_t> needle_twig(int size);
/// Blades of grass that stand on the bottom edge.
std::vector<uint8_t> grass_blades(int size);
/// Stems with white and yellow flowers that stand on the bottom edge.
std::vector<uint8_t> flowers(int size);

}  // namespace cli::scenes
