#include "scene/patches.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>

#define XXH_INLINE_ALL
#include <xxhash.h>

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

// Bounds on the second derivatives: a Bezier surface lies in the hull of its control points, and its derivatives are
// Bezier surfaces of the control points' differences.
struct Curvature {
  double uu = 0, uv = 0, vv = 0;
};

Curvature curvature_of(const ControlNet &net)
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
  return {6 * uu, 9 * uv, 6 * vv};
}

// The distance of a surface from triangles between its points that are no wider than 1 / n_u and no higher than 1 / n_v is
// at most (|Suu| / n_u^2 + 2 |Suv| / (n_u n_v) + |Svv| / n_v^2) / 8.
// Source: Filip, Magedson and Markot 1986, surface algorithms using bounds on derivatives, for right triangles.
// Differs: any triangle of that box. By Taylor's formula a point leaves the mean of the corners, weighted by its
// barycentrics, by half of what the second derivative makes of the corners' offsets; their mean square along an axis is a
// variance, and that is at most a quarter of the width squared (Popoviciu).
double error_of(const Curvature &c, double n_u, double n_v)
{
  return (c.uu / (n_u * n_u) + 2 * c.uv / (n_u * n_v) + c.vv / (n_v * n_v)) / 8;
}

struct Rates {
  double u, v;
};

// The least n_v that keeps the limit with n_u; infinite if none does.
double least_rate(const Curvature &c, double n_u, double limit)
{
  if (error_of(c, n_u, 1) <= limit) return 1;
  const double rest = 8 * limit - c.uu / (n_u * n_u), mixed = c.uv / n_u;
  if (!(rest > 0)) return INFINITY;
  double n_v = std::max(1.0, std::ceil((mixed + std::sqrt(mixed * mixed + rest * c.vv)) / rest));
  if (error_of(c, n_u, n_v) > limit) n_v += 1;  // rounding
  return error_of(c, n_u, n_v) <= limit ? n_v : INFINITY;
}

// Cells that keep the limit: as many along both, or fewer where less along one is enough.
Rates choose_rates(const Curvature &c, double limit)
{
  const double square = std::max(1.0, std::ceil(std::sqrt((c.uu + 2 * c.uv + c.vv) / (8 * limit))));
  Rates best{square, square};
  const auto consider = [&](Rates r) {
    if (r.u >= 1 && r.v >= 1 && r.u <= max_patch_cells && r.v <= max_patch_cells &&
        r.u * r.v < best.u * best.v)
      best = r;
  };
  // Where n_u : n_v is the root of |Suu| : |Svv|, the sum has its least value for their product.
  const double product = (std::sqrt(c.uu) * std::sqrt(c.vv) + c.uv) / (4 * limit);
  const double n_u = c.vv > 0 ? std::floor(std::sqrt(product * std::sqrt(c.uu / c.vv))) : 1;
  for (double n : {1.0, n_u, n_u + 1}) {
    if (!(n >= 1)) continue;
    consider({n, least_rate(c, n, limit)});
  }
  const Curvature turned{c.vv, c.uv, c.uu};
  consider({least_rate(turned, 1, limit), 1});
  return best;
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

Vec3d scaled_normal(ControlNet net, double u, double v)
{
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
  return unit_normal(net, u, v);
}

}  // namespace

namespace {

// Control points of the edges, as PatchCells counts these.
constexpr int edge_points[4][4] = {{0, 1, 2, 3}, {12, 13, 14, 15}, {0, 4, 8, 12}, {3, 7, 11, 15}};

// The same for all edges with the same points, from either end. Edges that meet here by chance get the same number of
// segments, which is no harm.
uint64_t key_of_edge(const PatchSource &source, uint64_t patch, int edge)
{
  double forward[13], backward[13];
  forward[12] = backward[12] = source.space;
  for (int k = 0; k < 4; ++k) {
    const Vec3d p = transform_point(
        source.place, to_double(source.patches->control_points[16 * patch + uint64_t(edge_points[edge][k])]));
    const double c[3] = {p.x + 0.0, p.y + 0.0, p.z + 0.0};  // no -0
    std::copy_n(c, 3, forward + 3 * k);
    std::copy_n(c, 3, backward + 3 * (3 - k));
  }
  const bool is_turned = std::lexicographical_compare(backward, backward + 12, forward, forward + 12);
  return XXH3_64bits(is_turned ? backward : forward, sizeof(forward));
}

// Of all patches; infinite: only pixels limit them.
double limit_of(const PatchSource &source, const PatchLimits &limits)
{
  if (limits.tolerance != 0) return double(limits.tolerance) / source.stretch;
  if (limits.pixels != 0) return INFINITY;
  const SharedArray<Vec3f> &points = source.patches->control_points;
  const Box b = union_of_boxes(points.size(), [&](uint64_t i) {
    const Vec3f p = points[i];
    return Box{p, p};
  });
  return 1e-4 * length(to_double(b.hi) - to_double(b.lo));
}

[[noreturn]] void fail_too_fine(const PatchSource &source, const PatchLimits &limits, double num_triangles)
{
  // Triangles grow no faster than as 1 / tolerance.
  const double factor = num_triangles / double(max_triangles) * 1.1;
  const double limit = limit_of(source, limits);
  if (limits.pixels != 0) {
    const std::string and_tolerance = limits.tolerance != 0 ? fmt::format(" and patch_tolerance to {:.3g}",
                                                                          double(limits.tolerance) * factor)
                                                            : "";
    fail_invalid(
        "geometry {}: a bound of {:.3g} pixels takes {:.3g} triangles for {} patches, more than 2^28; raise "
        "patch_pixels to {:.3g}{}",
        source.geometry, limits.pixels, num_triangles, source.patches->control_points.size() / 16,
        double(limits.pixels) * factor, and_tolerance);
  }
  fail_invalid(
      "geometry {}: a patch tolerance of {:.3g} takes {:.3g} triangles for {} patches, more than 2^28; raise "
      "patch_tolerance to {:.3g}",
      source.geometry, limit * source.stretch, num_triangles, source.patches->control_points.size() / 16,
      limit * source.stretch * factor);
}

// What the patches of a source want for themselves.
std::vector<PatchCells> own_cells(const PatchSource &source, const PatchLimits &limits)
{
  std::vector<PatchCells> cells(source.patches->control_points.size() / 16,
                                PatchCells{0, 1, 1, {1, 1, 1, 1}});
  if (cells.empty()) return cells;
  const double common = limit_of(source, limits);
  const double num_triangles = tbb::parallel_reduce(
      tbb::blocked_range<uint64_t>(0, cells.size(), 64), 0.0,
      [&](const tbb::blocked_range<uint64_t> &range, double sum) {
        for (uint64_t i = range.begin(); i != range.end(); ++i) {
          const double limit =
              source.pixel_limits.empty() ? common : std::min(common, source.pixel_limits[i]);
          if (limit == 0) continue;  // all points are one
          const Rates r = choose_rates(curvature_of(load(*source.patches, i)), limit);
          sum += 2 * r.u * r.v;
          const uint16_t u = uint16_t(std::min(r.u, double(max_patch_cells))),
                         v = uint16_t(std::min(r.v, double(max_patch_cells)));
          cells[i] = {0, u, v, {u, u, v, v}};
        }
        return sum;
      },
      [](double a, double b) { return a + b; });
  if (!(num_triangles <= double(max_triangles))) fail_too_fine(source, limits, num_triangles);
  return cells;
}

}  // namespace

std::vector<std::vector<PatchCells>> cut_patches(const std::vector<PatchSource> &sources,
                                                 const PatchLimits &limits)
{
  std::vector<std::vector<PatchCells>> all;
  std::unordered_map<uint64_t, uint16_t> segments;  // of each edge: the most that a patch at it wants
  std::vector<std::vector<uint64_t>> keys;
  for (const PatchSource &source : sources) {
    std::vector<PatchCells> &cells = all.emplace_back(own_cells(source, limits));
    std::vector<uint64_t> &own = keys.emplace_back(4 * cells.size());
    parallel_for_each(own.size(), [&](uint64_t k) { own[k] = key_of_edge(source, k / 4, int(k % 4)); });
    for (uint64_t k = 0; k < own.size(); ++k) {
      uint16_t &most = segments[own[k]];
      most = std::max(most, cells[k / 4].edge[k % 4]);
    }
  }
  for (size_t s = 0; s < sources.size(); ++s) {
    uint64_t num_triangles = 0;
    for (uint64_t i = 0; i < all[s].size(); ++i) {
      PatchCells &c = all[s][i];
      for (uint64_t e = 0; e < 4; ++e) c.edge[e] = segments.at(keys[s][4 * i + e]);
      // An edge wants no fewer than the patch does.
      c.num_u = std::max(c.edge[0], c.edge[1]);
      c.num_v = std::max(c.edge[2], c.edge[3]);
      c.first_triangle = uint32_t(num_triangles);
      num_triangles += uint64_t(2) * c.num_u * c.num_v;
      if (num_triangles > max_triangles)
        fail_too_fine(sources[s], limits, double(num_triangles) * double(all[s].size()) / double(i + 1));
    }
  }
  return all;
}

std::vector<double> tessellation_errors(const PatchData &patches, std::span<const PatchCells> cells)
{
  std::vector<double> errors(cells.size());
  parallel_for_each(cells.size(), [&](uint64_t i) {
    // Cells within are no larger than those of the rim.
    const PatchCells &c = cells[i];
    errors[i] = error_of(curvature_of(load(patches, i)), std::min(c.edge[0], c.edge[1]),
                         std::min(c.edge[2], c.edge[3]));
  });
  return errors;
}

double tessellation_error(const PatchData &patches, std::span<const PatchCells> cells)
{
  const std::vector<double> errors = tessellation_errors(patches, cells);
  return errors.empty() ? 0 : *std::max_element(errors.begin(), errors.end());
}

Vec3d position_on_patch(const Vec3f *points, double u, double v)
{
  const auto at = [](Vec3d p0, Vec3d p1, Vec3d p2, Vec3d p3, double t) {
    const double s = 1 - t;
    return p0 * (s * s * s) + p3 * (t * t * t) + (p1 * (3 * s * s * t) + p2 * (3 * t * t * s));
  };
  Vec3d column[4];
  for (int r = 0; r < 4; ++r) {
    const Vec3f *row = points + 4 * r;
    column[r] = at(to_double(row[0]), to_double(row[1]), to_double(row[2]), to_double(row[3]), u);
  }
  return at(column[0], column[1], column[2], column[3], v);
}

Vec3d normal_on_patch(const Vec3f *points, double u, double v)
{
  ControlNet net;
  for (int k = 0; k < 16; ++k) net.p[k / 4][k % 4] = to_double(points[k]);
  return scaled_normal(net, u, v);
}

TessellatedPatches::TessellatedPatches(const PatchData &patches, std::span<const PatchCells> cells)
    : patches_(patches), cells_(cells), first_vertex_(cells.size() + 1)
{
  for (size_t i = 0; i < cells.size(); ++i) {
    first_vertex_[i + 1] = first_vertex_[i] + uint64_t(cells[i].num_u + 1) * uint64_t(cells[i].num_v + 1);
    num_triangles_ += uint64_t(2) * cells[i].num_u * cells[i].num_v;
  }
}

TessellatedPatches::Location TessellatedPatches::locate(uint64_t vertex) const
{
  const auto after = std::upper_bound(first_vertex_.begin(), first_vertex_.end(), vertex);
  const uint64_t patch = uint64_t(after - first_vertex_.begin()) - 1;
  const PatchCells &c = cells_[patch];
  const uint64_t rest = vertex - first_vertex_[patch], width = uint64_t(c.num_u) + 1;
  const uint32_t i = uint32_t(rest % width), j = uint32_t(rest / width);
  return {patch, cell_u(c, i, j), cell_v(c, i, j)};
}

uint64_t patch_of_triangle(std::span<const PatchCells> cells, uint64_t triangle)
{
  const auto after = std::upper_bound(cells.begin(), cells.end(), triangle,
                                      [](uint64_t t, const PatchCells &c) { return t < c.first_triangle; });
  return uint64_t(after - cells.begin()) - 1;
}

UInt3 TessellatedPatches::triangle(uint64_t index) const
{
  const uint64_t patch = patch_of_triangle(cells_, index);
  const PatchCells &p = cells_[patch];
  const uint32_t local = uint32_t(index - p.first_triangle), i = local / 2 % p.num_u, j = local / 2 / p.num_u;
  const uint32_t a = uint32_t(first_vertex_[patch]) + j * (p.num_u + 1u) + i;
  const uint32_t b = a + 1, c = a + p.num_u + 1u, d = c + 1;
  if (is_turned(p, i, j)) return local % 2 == 0 ? UInt3{a, b, c} : UInt3{b, d, c};
  return local % 2 == 0 ? UInt3{a, b, d} : UInt3{a, d, c};
}

Vec3d TessellatedPatches::vertex(uint64_t index) const
{
  const auto [patch, u, v] = locate(index);
  const ControlNet net = load(patches_, patch);
  // On a boundary the other control points have no part in this: cubic_at takes an end as it is.
  Vec3d column[4];
  for (int r = 0; r < 4; ++r)
    column[r] = cubic_at(net.p[r][0], net.p[r][1], net.p[r][2], net.p[r][3], u.step, u.steps);
  return cubic_at(column[0], column[1], column[2], column[3], v.step, v.steps);
}

Vec3d TessellatedPatches::normal(uint64_t index) const
{
  const auto [patch, u, v] = locate(index);
  return scaled_normal(load(patches_, patch), double(u.step) / double(u.steps),
                       double(v.step) / double(v.steps));
}

Vec2f TessellatedPatches::uv(uint64_t index) const
{
  const auto [patch, u, v] = locate(index);
  return {float(double(u.step) / double(u.steps)), float(double(v.step) / double(v.steps))};
}

}  // namespace gpurt
