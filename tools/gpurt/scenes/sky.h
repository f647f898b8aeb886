// A sky with clouds, as a lat-long image.
#pragma once

#include <vector>

#include "mesh.h"

namespace cli::scenes {

/// Radiance .hdr file. The sun itself is not in it, its glow is. `to_sun` has unit length.
std::vector<uint8_t> make_sky(int width, int height, Vec3 to_sun);

}  // namespace cli::scenes
