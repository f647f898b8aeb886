#include "scene/patch_pixels.h"

#include <algorithm>
#include <atomic>
#include <cmath>

#include "error.h"
#include "scene/parallel.h"

namespace gpurt {
namespace {

// Pieces of a patch are no smaller than 2^-8 of it, and there are no more than about a thousand of them: a surface that
// is no knot about the eye has a few at every level.
constexpr int max_cuts = 8, max_pieces = 1024;

struct Hull {
  Vec3d p[4][4];  // of the camera, with z the depth
};

struct Bounds {
  Vec3d lo, hi;
};

Bounds bounds_of(const Hull &hull)
{
  Bounds b{hull.p[0][0], hull.p[0][0]};
  for (const auto &row : hull.p) {
    for (const Vec3d &p : row) {
      b.lo = {std::min(b.lo.x, p.x), std::min(b.lo.y, p.y), std::min(b.lo.z, p.z)};
      b.hi = {std::max(b.hi.x, p.x), std::max(b.hi.y, p.y), std::max(b.hi.z, p.z)};
    }
  }
  return b;
}

double distance_from_eye(const Bounds &b)
{
  const auto away = [](double lo, double hi) { return std::max(std::max(lo, -hi), 0.0); };
  return length(Vec3d{away(b.lo.x, b.hi.x), away(b.lo.y, b.hi.y), away(b.lo.z, b.hi.z)});
}

// The depth of what the picture shows within these bounds is at least this: where it shows a point, its depth is no less
// than its distance times the cosine at the corner.
double least_depth(const Bounds &b, const PatchPicture &picture)
{
  return std::max(b.lo.z, distance_from_eye(b) / std::sqrt(1 + picture.corner * picture.corner));
}

double limit_at(double depth, double tangent, const PatchPicture &picture)
{
  const double r = std::min(tangent, picture.corner) + picture.distance;
  return depth * picture.distance / (std::sqrt(1 + r * r) + picture.distance);
}

// The largest tangent; the set of points below one is a cone, which has the hull if it has the control points.
double tangent_of(const Hull &hull)
{
  double r = 0;
  for (const auto &row : hull.p) {
    for (const Vec3d &p : row) r = std::max(r, p.z > 0 ? std::hypot(p.x, p.y) / p.z : INFINITY);
  }
  return r;
}

void cut_curve(const Vec3d (&p)[4], Vec3d (&a)[4], Vec3d (&b)[4])
{
  const auto middle = [](Vec3d u, Vec3d v) { return (u + v) * 0.5; };
  const Vec3d q = middle(p[1], p[2]);
  a[0] = p[0], a[1] = middle(p[0], p[1]), a[2] = middle(a[1], q);
  b[3] = p[3], b[2] = middle(p[2], p[3]), b[1] = middle(q, b[2]);
  a[3] = b[0] = middle(a[2], b[1]);
}

Hull transposed(const Hull &h)
{
  Hull t;
  for (int r = 0; r < 4; ++r) {
    for (int c = 0; c < 4; ++c) t.p[c][r] = h.p[r][c];
  }
  return t;
}

void cut(const Hull &h, Hull &a, Hull &b)
{
  for (int r = 0; r < 4; ++r) cut_curve(h.p[r], a.p[r], b.p[r]);
}

struct Limit {
  double distance;
  bool is_bound;
};

Limit limit_of(const Hull &hull, const PatchPicture &picture, int cuts, int &num_pieces)
{
  const Bounds b = bounds_of(hull);
  const double depth = least_depth(b, picture), size = length(b.hi - b.lo);
  // Further away than half its length, pieces would not be much further.
  if (depth >= 0.5 * size) return {limit_at(depth, tangent_of(hull), picture), true};
  if (cuts == 0 || (num_pieces += 4) > max_pieces) {
    // The eye is there: as if the piece were as far away as half its length. What is behind the eye is in no picture.
    return {limit_at(0.5 * size, picture.corner, picture), b.hi.z <= 0};
  }
  Hull halves[2], quarters[2];
  cut(hull, halves[0], halves[1]);
  Limit least{INFINITY, true};
  for (const Hull &half : halves) {
    cut(transposed(half), quarters[0], quarters[1]);
    for (const Hull &quarter : quarters) {
      const Limit l = limit_of(quarter, picture, cuts - 1, num_pieces);
      least = {std::min(least.distance, l.distance), least.is_bound && l.is_bound};
    }
  }
  return least;
}

struct Placed {
  AffineDouble object_to_camera;
  double stretch;
  double least;  // no patch has a lower limit
};

AffineDouble camera_of(const CameraData &camera)
{
  // Scale and shear are ignored, as a frame's camera ignores them.
  const Transform &t = camera.transform;
  const auto column = [&](int c) { return Vec3d{t.m[0][c], t.m[1][c], t.m[2][c]}; };
  const Vec3d z = normalize(column(2)), x = normalize(cross(column(1), z)), y = cross(z, x), eye = column(3);
  return {x.x, x.y, x.z, -dot(x, eye), y.x, y.y, y.z, -dot(y, eye), -z.x, -z.y, -z.z, dot(z, eye)};
}

}  // namespace

PatchPicture make_patch_picture(const std::vector<CameraData> &cameras, const PatchLimits &limits)
{
  if (limits.camera >= cameras.size()) {
    fail_invalid(
        "patch_camera is {}, but the scene has {} cameras, in whose pixels patch_pixels counts; add one with "
        "gpurt_scene_add_camera, or use patch_tolerance",
        limits.camera, cameras.size());
  }
  const CameraData &camera = cameras[limits.camera];
  const auto size = [](uint32_t wanted, uint32_t own) { return wanted != 0 ? wanted : own != 0 ? own : 512; };
  const double width = size(limits.width, camera.width), height = size(limits.height, camera.height);
  const double top = std::tan(0.5 * double(camera.yfov_rad));
  PatchPicture picture;
  picture.world_to_camera = camera_of(camera);
  picture.distance = double(limits.pixels) * 2 * top / height;
  picture.corner = top * std::hypot(1.0, width / height);
  return picture;
}

PixelLimits pixel_limits_of(const PatchData &patches, const std::vector<AffineDouble> &placements,
                            const PatchPicture &picture)
{
  const SharedArray<Vec3f> &points = patches.control_points;
  const uint64_t num_patches = points.size() / 16;
  const Box box = union_of_boxes(points.size(), [&](uint64_t i) { return Box{points[i], points[i]}; });
  std::vector<Placed> placed;
  for (const AffineDouble &placement : placements) {
    Placed p{multiply(picture.world_to_camera, placement), largest_stretch(placement), 0};
    if (num_patches != 0) {
      Hull corners;
      for (int k = 0; k < 16; ++k) {
        corners.p[k / 4][k % 4] = transform_point(
            p.object_to_camera,
            {k & 1 ? box.hi.x : box.lo.x, k & 2 ? box.hi.y : box.lo.y, k & 4 ? box.hi.z : box.lo.z});
      }
      p.least = limit_at(least_depth(bounds_of(corners), picture), picture.corner, picture) / p.stretch;
    }
    placed.push_back(p);
  }
  // The first ones decide: of many placements few are looked at.
  std::sort(placed.begin(), placed.end(), [](const Placed &a, const Placed &b) { return a.least < b.least; });

  PixelLimits limits{std::vector<double>(num_patches, INFINITY), true};
  std::atomic<bool> is_bound = true;
  tbb::parallel_for(tbb::blocked_range<uint64_t>(0, num_patches, 64), [&](const auto &range) {
    for (uint64_t i = range.begin(); i != range.end(); ++i) {
      double &least = limits.distances[i];
      for (const Placed &p : placed) {
        if (p.least >= least) break;
        Hull hull;
        for (int k = 0; k < 16; ++k)
          hull.p[k / 4][k % 4] = transform_point(p.object_to_camera, to_double(points[16 * i + uint64_t(k)]));
        int num_pieces = 0;
        const Limit l = limit_of(hull, picture, max_cuts, num_pieces);
        if (!l.is_bound) is_bound.store(false, std::memory_order_relaxed);
        least = std::min(least, l.distance / p.stretch);
      }
    }
  });
  limits.is_bound = is_bound;
  return limits;
}

}  // namespace gpurt
