// Plants of the outdoor scene, standing on the origin. Cards take the textures of texture.h.
#pragma once

#include "mesh.h"

namespace cli::scenes {

/// Bark and leaves of one tree.
struct Tree {
  Mesh wood, leaves;
};

/// `detail` scales the number of twigs; heights are in metres.
Tree broad_leaved_tree(uint64_t seed, double height, double detail);
Tree fir_tree(uint64_t seed, double height, double detail);

/// Crossed cards with blades on them, and with flowers.
Mesh grass_tuft(uint64_t seed);
Mesh flower_tuft(uint64_t seed);

}  // namespace cli::scenes
