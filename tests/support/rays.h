// Rays that are hard on a ray tracer: at edges, through vertices, along axes, in split planes, grazing.
#pragma once

#include <limits>
#include <set>

#include "meshes.h"

namespace gpurt_test {

constexpr float infinite = std::numeric_limits<float>::infinity();

inline gpurt_ray make_ray(Point origin, Point direction, float tmin = 0, float tmax = infinite)
{
  return {{origin[0], origin[1], origin[2]}, tmin, {direction[0], direction[1], direction[2]}, tmax};
}

/// From a point to another: t is 1 there, up to the rounding of their difference.
inline gpurt_ray ray_towards(Point origin, Point target, float tmin = 0, float tmax = infinite)
{
  return make_ray(origin, {target[0] - origin[0], target[1] - origin[1], target[2] - origin[2]}, tmin, tmax);
}

inline Point uniform_direction(std::mt19937_64 &rng)
{
  for (;;) {
    double d[3], length2 = 0;
    for (double &c : d) c = uniform(rng, -1, 1), length2 += c * c;
    if (length2 > 1 || length2 < 1e-4) continue;
    const double s = 1 / std::sqrt(length2);
    return {float(d[0] * s), float(d[1] * s), float(d[2] * s)};
  }
}

/// A point on the segment from a to b.
inline Point between(Point a, Point b, double s)
{
  return {float(a[0] + s * (double(b[0]) - a[0])), float(a[1] + s * (double(b[1]) - a[1])),
          float(a[2] + s * (double(b[2]) - a[2]))};
}

inline Point point_in_triangle(const Mesh &mesh, size_t triangle, double u, double v)
{
  if (u + v > 1) u = 1 - u, v = 1 - v;
  const Point a = mesh.corner(triangle, 0), b = mesh.corner(triangle, 1), c = mesh.corner(triangle, 2);
  Point p;
  for (int k = 0; k < 3; ++k) p[k] = float(a[k] + u * (double(b[k]) - a[k]) + v * (double(c[k]) - a[k]));
  return p;
}

struct Bounds {
  Point lo = {infinite, infinite, infinite}, hi = {-infinite, -infinite, -infinite};

  float extent() const { return std::max({hi[0] - lo[0], hi[1] - lo[1], hi[2] - lo[2]}); }
  Point centre() const { return between(lo, hi, 0.5); }
  /// A point in the box, enlarged about its centre by `factor`; flat boxes are given depth.
  Point sample(std::mt19937_64 &rng, double factor = 1) const
  {
    Point p;
    const Point c = centre();
    for (int k = 0; k < 3; ++k) {
      const double half = std::max(0.5 * (double(hi[k]) - lo[k]), factor > 1 ? 0.25 * extent() : 0.0);
      p[k] = float(c[k] + factor * half * uniform(rng, -1, 1));
    }
    return p;
  }
};

inline Bounds bounds_of(const Mesh &mesh)
{
  Bounds b;
  for (const Point &v : mesh.vertices) {
    for (int k = 0; k < 3; ++k) b.lo[k] = std::min(b.lo[k], v[k]), b.hi[k] = std::max(b.hi[k], v[k]);
  }
  return b;
}

using Edge = std::array<uint32_t, 2>;

inline std::vector<Edge> edges_of(const Mesh &mesh)
{
  std::set<Edge> edges;
  for (const auto &t : mesh.triangles) {
    for (int k = 0; k < 3; ++k) {
      const auto e = std::minmax(t[k], t[(k + 1) % 3]);
      edges.insert({e.first, e.second});
    }
  }
  return {edges.begin(), edges.end()};
}

/// True if every edge is passed as often in one direction as in the other.
inline bool is_closed(const Mesh &mesh)
{
  std::map<Edge, int> balance;
  for (const auto &t : mesh.triangles) {
    for (int k = 0; k < 3; ++k) {
      const uint32_t a = t[k], b = t[(k + 1) % 3];
      balance[{std::min(a, b), std::max(a, b)}] += a < b ? 1 : -1;
    }
  }
  return std::all_of(balance.begin(), balance.end(), [](const auto &e) { return e.second == 0; });
}

struct SplitPlane {
  int axis;
  float position;
};

/// The split planes of a tree as the exchange hands it out.
inline std::vector<SplitPlane> split_planes(const std::vector<gpurt_kdtree_node> &nodes)
{
  std::vector<SplitPlane> planes;
  for (const auto &n : nodes) {
    float position;
    std::memcpy(&position, &n.word, sizeof position);
    if ((n.tag & 3u) != 3u) planes.push_back({int(n.tag & 3u), position});
  }
  return planes;
}

enum class RayKind { Random, EdgeMidpoint, Edge, Vertex, Axis, SplitPlane, Grazing, OnSurface, Count };
inline const char *const ray_kind_names[] = {"random", "edge midpoint", "edge",    "vertex",
                                             "axis",   "split plane",   "grazing", "on surface"};

/// Makes rays of every kind at a mesh; `planes` may be empty.
class RaySource {
 public:
  RaySource(const Mesh &mesh, std::vector<SplitPlane> planes, uint64_t seed)
      : mesh_(mesh), planes_(std::move(planes)), edges_(edges_of(mesh)), bounds_(bounds_of(mesh)), rng_(seed)
  {}

  std::mt19937_64 &rng() { return rng_; }
  const Bounds &bounds() const { return bounds_; }

  gpurt_ray operator()(RayKind kind)
  {
    const Point origin = bounds_.sample(rng_, 1.5);
    switch (kind) {
      case RayKind::EdgeMidpoint:
        return ray_towards(origin, edge_point(0.5));
      case RayKind::Edge:
        return ray_towards(origin, edge_point(uniform(rng_)));
      case RayKind::Vertex:
        return ray_towards(origin, vertex());
      case RayKind::Axis:
        return axis_ray(origin);
      case RayKind::SplitPlane:
        return plane_ray(origin);
      case RayKind::Grazing:
        return grazing_ray();
      case RayKind::OnSurface:
        return surface_ray(origin);
      default:
        return make_ray(origin, uniform_direction(rng_));
    }
  }

 private:
  Point vertex() { return mesh_.corner(pick(rng_, mesh_.triangles.size()), int(pick(rng_, 3))); }
  Point edge_point(double s)
  {
    const Edge e = edges_[pick(rng_, edges_.size())];
    return between(mesh_.vertices[e[0]], mesh_.vertices[e[1]], s);
  }

  // Parallel to an axis, half of them through a vertex; the zeros of the direction have either sign.
  gpurt_ray axis_ray(Point origin)
  {
    const int axis = int(pick(rng_, 3));
    const Point v = vertex();
    Point d;
    for (int k = 0; k < 3; ++k) d[k] = k == axis ? (rng_() & 1 ? 1.0f : -1.0f) : (rng_() & 1 ? 0.0f : -0.0f);
    const bool at_vertex = rng_() & 1;
    for (int k = 0; k < 3; ++k) {
      if (at_vertex && k != axis) origin[k] = v[k];
    }
    return make_ray(origin, d);
  }

  // The origin in a split plane; the direction off it, in it, or towards a vertex.
  gpurt_ray plane_ray(Point origin)
  {
    if (planes_.empty()) return make_ray(origin, uniform_direction(rng_));
    const SplitPlane plane = planes_[pick(rng_, planes_.size())];
    origin[plane.axis] = plane.position;
    if (pick(rng_, 3) == 0) return ray_towards(origin, vertex());
    Point d = uniform_direction(rng_);
    if (rng_() & 1) d[plane.axis] = rng_() & 1 ? 0.0f : -0.0f;
    return make_ray(origin, d);
  }

  // Almost in the plane of a triangle, through a point of it.
  gpurt_ray grazing_ray()
  {
    const size_t i = pick(rng_, mesh_.triangles.size());
    const Point p = point_in_triangle(mesh_, i, uniform(rng_), uniform(rng_));
    const Point q =
        between(mesh_.corner(i, int(pick(rng_, 3))), mesh_.corner(i, int(pick(rng_, 3))), uniform(rng_));
    const double reach = 0.7 * bounds_.extent();
    double d[3], length2 = 0;
    for (int k = 0; k < 3; ++k) d[k] = double(q[k]) - p[k], length2 += d[k] * d[k];
    if (!(length2 > 0)) return make_ray(p, uniform_direction(rng_));
    Point origin, direction;
    for (int k = 0; k < 3; ++k) {
      direction[k] = float(d[k] / std::sqrt(length2));
      origin[k] = float(p[k] - reach * direction[k]);
    }
    return make_ray(origin, direction);
  }

  // The origin at a vertex, on an edge or in a triangle, up to rounding.
  gpurt_ray surface_ray(Point elsewhere)
  {
    const size_t what = pick(rng_, 3);
    const Point p = what == 0   ? vertex()
                    : what == 1 ? edge_point(uniform(rng_))
                                : point_in_triangle(mesh_, pick(rng_, mesh_.triangles.size()), uniform(rng_),
                                                    uniform(rng_));
    return rng_() & 1 ? make_ray(p, uniform_direction(rng_)) : ray_towards(p, elsewhere);
  }

  const Mesh &mesh_;
  std::vector<SplitPlane> planes_;
  std::vector<Edge> edges_;
  Bounds bounds_;
  std::mt19937_64 rng_;
};

}  // namespace gpurt_test
