#include "scene/patches.h"

#include <algorithm>
#include <cmath>

#include "error.h"
#include "scene/parallel.h"

namespace gpurt {
namespace {

constexpr uint64_t max_triangles = uint64_t(1) << 28;

struct ControlNet {
  Vec3d p[4][4];  // row (v), column (u)
};

ControlNet load(const PatchData &patches, uint64_t patch)
{
  ControlNet net;
  for (int k = 0; k < 16; ++k) net.p[k / 4][k % 4] = to_double(patches.control_points[16 * patch + k]);
  return net;
}

// Bound on |Suu| + 2 |Suv| + |Svv|: a Bezier surface lies in the hull of its control points, and its derivatives are
// Bezier surfaces of the control points' differences.
double curvature_bound(const ControlNet &net)
{
  double uu = 0, uv = 0, vv = 0;
  for (int r = 0; r < 4; ++r) {
    for (int c = 0; c < 2; ++c) {
      uu = std::max(uu, length(net.p[r][c + 2] - net.p[r][c + 1] * 2 + net.p[r][c]));
      vv = std::max(vv, length(net.p[c + 2][r] - net.p[c + 1][r] * 2 + net.p[c][r]));
    }
  }
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) {
      uv = std::max(uv, length(net.p[r + 1][c + 1] - net.p[r + 1][c] - net.p[r][c + 1] + net.p[r][c]));
    }
  }
  return 6 * uu + 2 * 9 * uv + 6 * vv;
}

// A point of a cubic at i / n. The weights are whole numbers, exact in double, and the products are added in pairs from
// both ends: the curve run backwards gives the same bits.
Vec3d cubic_at(Vec3d p0, Vec3d p1, Vec3d p2, Vec3d p3, uint64_t i, uint64_t n)
{
  if (i == 0) return p0;
  if (i == n) return p3;
  const double a = double(n - i), b = double(i);
  const double scale = double(n) * double(n) * double(n);
  const Vec3d ends = p0 * (a * a * a) + p3 * (b * b * b);
  const Vec3d middle = p1 * (3 * (a * a * b)) + p2 * (3 * (b * b * a));
  const Vec3d sum = ends + middle;
  return {sum.x / scale, sum.y / scale, sum.z / scale};
}

struct Derivatives {
  Vec3d du, dv;
};

Derivatives derivatives_at(const ControlNet &net, double u, double v)
{
  const double bu[4] = {(1 - u) * (1 - u) * (1 - u), 3 * u * (1 - u) * (1 - u), 3 * u * u * (1 - u),
                        u * u * u};
  const double bv[4] = {(1 - v) * (1 - v) * (1 - v), 3 * v * (1 - v) * (1 - v), 3 * v * v * (1 - v),
                        v * v * v};
  const double qu[3] = {3 * (1 - u) * (1 - u), 6 * u * (1 - u), 3 * u * u};
  const double qv[3] = {3 * (1 - v) * (1 - v), 6 * v * (1 - v), 3 * v * v};
  Derivatives d{{0, 0, 0}, {0, 0, 0}};
  for (int r = 0; r < 4; ++r) {
    for (int c = 0; c < 3; ++c) {
      d.du = d.du + (net.p[r][c + 1] - net.p[r][c]) * (qu[c] * bv[r]);
      d.dv = d.dv + (net.p[c + 1][r] - net.p[c][r]) * (qv[c] * bu[r]);
    }
  }
  return d;
}

// The normal of a net that is scaled to about 1.
Vec3d unit_normal(const ControlNet &net, double u, double v)
{
  // Where the product of the derivatives vanishes, go towards the patch's centre, in the smallest step whose normal
  // stands out from rounding (about 2^-52).
  for (double step : {0.0, 0x1p-16, 0x1p-12, 0x1p-8, 0x1p-4, 0.5, 1.0}) {
    const Derivatives d = derivatives_at(net, u + step * (0.5 - u), v + step * (0.5 - v));
    const Vec3d n = cross(d.du, d.dv);
    if (max_component_abs(n) > (step == 0 ? 0x1p-30 : 0x1p-40)) return normalize(n);
  }
  return {0, 0, 1};  // the patch is a curve or a point: it has no area and is never hit
}

}  // namespace

namespace {

// Of all patches.
double curvature_bound(const PatchData &patches)
{
  return tbb::parallel_reduce(
      tbb::blocked_range<uint64_t>(0, patches.control_points.size() / 16, 64), 0.0,
      [&](const tbb::blocked_range<uint64_t> &r, double m) {
        for (uint64_t i = r.begin(); i != r.end(); ++i) m = std::max(m, curvature_bound(load(patches, i)));
        return m;
      },
      [](double a, double b) { return std::max(a, b); });
}

}  // namespace

// The distance of a surface from the triangles between its samples at steps of 1/n is at most
// (|Suu| + 2 |Suv| + |Svv|) / (8 n^2).
// Source: Filip, Magedson and Markot 1986, surface algorithms using bounds on derivatives.
double tessellation_error(const PatchData &patches, uint32_t rate)
{
  return curvature_bound(patches) / (8 * double(rate) * double(rate));
}

uint32_t tessellation_rate(const PatchData &patches, float tolerance, double stretch)
{
  const uint64_t num_patches = patches.control_points.size() / 16;
  if (num_patches == 0) return 1;
  double limit = tolerance / stretch;
  if (tolerance == 0) {
    const Box b = union_of_boxes(patches.control_points.size(), [&](uint64_t i) {
      const Vec3f p = patches.control_points[i];
      return Box{p, p};
    });
    limit = 1e-4 * length(to_double(b.hi) - to_double(b.lo));
    if (limit == 0) return 1;  // all points are one
  }
  const double bound = curvature_bound(patches);
  const double rate = std::max(1.0, std::ceil(std::sqrt(bound / (8 * limit))));
  const double num_triangles = 2 * rate * rate * double(num_patches);
  if (!(num_triangles <= double(max_triangles))) {
    const double coarsest = bound * double(num_patches) * 2 / (8 * double(max_triangles));
    fail_invalid(
        "a patch tolerance of {:.3g} takes {:.3g} triangles for {} patches, more than 2^28; raise "
        "patch_tolerance to {:.3g}",
        limit * stretch, num_triangles, num_patches, coarsest * 1.1 * stretch);
  }
  return uint32_t(rate);
}

TessellatedPatches::TessellatedPatches(const PatchData &patches, uint32_t rate)
    : patches_(patches),
      rate_(rate),
      vertices_per_patch_(uint64_t(rate + 1) * (rate + 1)),
      num_patches_(patches.control_points.size() / 16)
{}

TessellatedPatches::Location TessellatedPatches::locate(uint64_t vertex) const
{
  const uint64_t rest = vertex % vertices_per_patch_;
  return {vertex / vertices_per_patch_, rest % (rate_ + 1), rest / (rate_ + 1)};
}

UInt3 TessellatedPatches::triangle(uint64_t i) const
{
  const uint64_t patch = i / (2 * rate_ * rate_), cell = i % (2 * rate_ * rate_) / 2;
  const uint32_t a = uint32_t(patch * vertices_per_patch_ + cell / rate_ * (rate_ + 1) + cell % rate_);
  const uint32_t b = a + 1, c = a + uint32_t(rate_) + 1, d = c + 1;
  if (i % 2 == 0) return {a, b, d};
  return {a, d, c};
}

Vec3d TessellatedPatches::vertex(uint64_t index) const
{
  const auto [patch, i, j] = locate(index);
  const ControlNet net = load(patches_, patch);
  const auto &p = net.p;
  // Boundary curves come from their own control points alone.
  if (j == 0 || j == rate_) {
    const auto &row = p[j == 0 ? 0 : 3];
    return cubic_at(row[0], row[1], row[2], row[3], i, rate_);
  }
  Vec3d column[4];
  for (int r = 0; r < 4; ++r) column[r] = cubic_at(p[r][0], p[r][1], p[r][2], p[r][3], i, rate_);
  return cubic_at(column[0], column[1], column[2], column[3], j, rate_);
}

Vec3d TessellatedPatches::normal(uint64_t index) const
{
  const auto [patch, i, j] = locate(index);
  ControlNet net = load(patches_, patch);
  const Vec3d origin = net.p[0][0];
  double scale = 0;
  for (auto &row : net.p) {
    for (Vec3d &p : row) {
      p = p - origin;
      scale = std::max(scale, max_component_abs(p));
    }
  }
  if (scale == 0) return {0, 0, 1};
  for (auto &row : net.p) {
    for (Vec3d &p : row) p = p * (1 / scale);
  }
  return unit_normal(net, double(i) / double(rate_), double(j) / double(rate_));
}

Vec2f TessellatedPatches::uv(uint64_t index) const
{
  const auto [patch, i, j] = locate(index);
  return {float(double(i) / double(rate_)), float(double(j) / double(rate_))};
}

}  // namespace gpurt
