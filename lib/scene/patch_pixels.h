// How far the triangles of patches may leave the surface if that is to be less than so many pixels of a picture.
//
// In tangents of the view, where a point is (x, y) / depth, a pixel is 2 tan(fov / 2) / height wide. A point P of the surface at
// depth Z and tangent r, and one within a distance e of it, are apart by at most e q / (Z - e) there, with q^2 = 1 + (r + t)^2
// as long as they are no more than t apart. With e = t Z / (q + t) that is t.
//
// So every patch has a limit by the least depth at which the picture can show it, as proven by the hull of its control
// points; those near the eye are cut into pieces for it. Other patches at its edges may ask for more.
#pragma once

#include <vector>

#include "scene/affine.h"
#include "scene/patch_limits.h"
#include "scene/scene_data.h"

namespace gpurt {

/// A picture, and how far points may be apart in it.
struct PatchPicture {
  AffineDouble world_to_camera{};  // the camera looks along -z
  double distance = 0;             // in tangents
  double corner = 0;               // tangent of the angle from the axis to the picture's corner
};

/// Throws INVALID_ARGUMENT for a camera or a size that is not there.
PatchPicture make_patch_picture(const std::vector<CameraData> &cameras, const PatchLimits &limits);

struct PixelLimits {
  std::vector<double> distances;  // of each patch, in object space, for all placements
  bool is_bound;  // false: the eye is so near to what the picture may show that the limit there is a guess
};

PixelLimits pixel_limits_of(const PatchData &patches, const std::vector<AffineDouble> &placements,
                            const PatchPicture &picture);

}  // namespace gpurt
