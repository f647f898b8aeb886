// Three ray/triangle tests: watertight, Moeller-Trumbore, and watertight in double precision.
//
// Watertight: the ray is sheared onto the axis of its largest direction component, where it becomes the point (0, 0),
// and the three edge functions of the sheared triangle must not differ in sign.
// Source: Woop, Benthin and Wald 2013.
// Differs: the shear serves both sides, without the swap for winding; edge functions have the exact sign of the sheared
// corners for any input; once a triangle is accepted its t, u and v are measured anew in double precision, because the
// sheared corners carry rounding errors that a grazing ray magnifies without bound.
//
// No result depends on the order of the corners' triangles in memory, on the vector width or on the compiler: all is
// rounded IEEE arithmetic without fma.
#pragma once

#include "core/accel/trace_ray.h"

namespace gpurt {

struct TriangleHit {
  float t;
  float u, v;  // barycentric weights of the second and third corner
};

// Who owns a point that lies exactly on an edge. Inclusive: every triangle that has the edge. HalfOpen: of two triangles
// of the same orientation exactly one, of a silhouette's two both or none, so that a closed surface is crossed an even
// number of times.
enum class EdgeRule { Inclusive, HalfOpen };

// What a test computes once per ray.
template <TriangleTest Test>
struct TriangleRay;

template <>
struct TriangleRay<TriangleTest::Watertight> {
  Vec3f origin, direction;
  float sx, sy, sz;
  int kx, ky, kz;
};

template <>
struct TriangleRay<TriangleTest::MollerTrumbore> {
  Vec3f origin, direction;
};

template <>
struct TriangleRay<TriangleTest::Double> {
  Vec3f origin, direction;
  double sx, sy;
  int kx, ky, kz;
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE void make_triangle_ray(const TraceRay &ray, TriangleRay<TriangleTest::Watertight> &r)
{
  r.origin = ray.origin;
  r.direction = ray.direction;
  r.kz = ray.main_axis;
  r.kx = r.kz == 2 ? 0 : r.kz + 1;
  r.ky = r.kx == 2 ? 0 : r.kx + 1;
  r.sz = 1.0f / at(ray.direction, r.kz);
  r.sx = at(ray.direction, r.kx) * r.sz;
  r.sy = at(ray.direction, r.ky) * r.sz;
}

GPURT_INLINE void make_triangle_ray(const TraceRay &ray, TriangleRay<TriangleTest::MollerTrumbore> &r)
{
  r.origin = ray.origin;
  r.direction = ray.direction;
}

GPURT_INLINE void make_triangle_ray(const TraceRay &ray, TriangleRay<TriangleTest::Double> &r)
{
  r.origin = ray.origin;
  r.direction = ray.direction;
  r.kz = ray.main_axis;
  r.kx = r.kz == 2 ? 0 : r.kz + 1;
  r.ky = r.kx == 2 ? 0 : r.kx + 1;
  const double sz = 1.0 / double(at(ray.direction, r.kz));
  r.sx = double(at(ray.direction, r.kx)) * sz;
  r.sy = double(at(ray.direction, r.ky)) * sz;
}

// A corner in the plane across the ray.
template <class Real>
struct ShearedPoint {
  Real x, y;
};

GPURT_INLINE ShearedPoint<float> shear(const TriangleRay<TriangleTest::Watertight> &r, Vec3f p)
{
  const float z = at(p, r.kz) - at(r.origin, r.kz);
  return {(at(p, r.kx) - at(r.origin, r.kx)) - r.sx * z, (at(p, r.ky) - at(r.origin, r.ky)) - r.sy * z};
}

GPURT_INLINE ShearedPoint<double> shear(const TriangleRay<TriangleTest::Double> &r, Vec3f p)
{
  const double z = double(at(p, r.kz)) - double(at(r.origin, r.kz));
  return {(double(at(p, r.kx)) - double(at(r.origin, r.kx))) - r.sx * z,
          (double(at(p, r.ky)) - double(at(r.origin, r.ky))) - r.sy * z};
}

// A sheared corner as the exact path sees it: the very float values of the fast path, so that both paths speak of the
// same mesh; where they overflowed, the shear in double.
GPURT_INLINE ShearedPoint<double> shear_exact(const TriangleRay<TriangleTest::Watertight> &r, Vec3f p,
                                              ShearedPoint<float> q)
{
  if (is_finite(q.x) && is_finite(q.y)) return {double(q.x), double(q.y)};
  const double z = double(at(p, r.kz)) - double(at(r.origin, r.kz));
  return {(double(at(p, r.kx)) - double(at(r.origin, r.kx))) - double(r.sx) * z,
          (double(at(p, r.ky)) - double(at(r.origin, r.ky))) - double(r.sy) * z};
}

// Twice the signed area of (0, 0), p, q. Rounding is monotonic, so that the rounded products are ordered as the exact
// ones: a result that is neither 0 nor NaN has the exact sign. Of floats in double, the products are exact, and 0 is
// exact too.
template <class Real>
GPURT_INLINE Real edge_function(ShearedPoint<Real> p, ShearedPoint<Real> q)
{
  return p.x * q.y - p.y * q.x;
}

// The half-open rule: as if the ray were moved by (-d, d^2) for an infinitesimal d. For an edge from p to q of a
// triangle that winds positively about (0, 0), with an edge function of exactly 0.
template <class Real>
GPURT_INLINE bool owns_edge(ShearedPoint<Real> p, ShearedPoint<Real> q)
{
  return p.y < q.y || (p.y == q.y && p.x < q.x);
}

// The signs' verdict. The triangle winds a, c, b where its edge functions are positive, a, b, c where negative.
template <EdgeRule Rule, class Real>
GPURT_INLINE bool accept_edges(ShearedPoint<Real> a, ShearedPoint<Real> b, ShearedPoint<Real> c, Real eu,
                               Real ev, Real ew)
{
  const bool any_negative = eu < 0 || ev < 0 || ew < 0;
  const bool any_positive = eu > 0 || ev > 0 || ew > 0;
  if (any_negative == any_positive) return false;  // outside; or all are 0: seen edge-on
  if constexpr (Rule == EdgeRule::HalfOpen) {
    if (eu == 0 && !(any_positive ? owns_edge(c, b) : owns_edge(b, c))) return false;
    if (ev == 0 && !(any_positive ? owns_edge(a, c) : owns_edge(c, a))) return false;
    if (ew == 0 && !(any_positive ? owns_edge(b, a) : owns_edge(a, b))) return false;
  }
  return true;
}

// What the edge functions say of the corners.
struct EdgeWeights {
  double u, v, w;
};

// Where the ray meets the plane of a triangle that it was found to meet: t, u and v in double, rounded once.
//
// Coordinates are floats, so that a plane seen at an angle of 1e-3 through a needle of 1e5:1 still gives t to half an
// ulp of a float. A ray that passes outside by no more than the test's rounding gets the weights clamped to the
// triangle, and t to the triangle's extent along the main axis; edge-on, where the plane says nothing, the weights of
// the edge functions serve.
// edge_weights() is called for these.
// Source: Moeller and Trumbore 1997 for the formula.
template <class Weights>
GPURT_HD inline bool measure_hit(Vec3f origin, Vec3f direction, int main_axis, Vec3f a, Vec3f b, Vec3f c,
                                 Weights &&edge_weights, float tmin, float tmax, TriangleHit &hit)
{
  const double dx = direction.x, dy = direction.y, dz = direction.z;
  const double e1x = double(b.x) - double(a.x), e1y = double(b.y) - double(a.y),
               e1z = double(b.z) - double(a.z);
  const double e2x = double(c.x) - double(a.x), e2y = double(c.y) - double(a.y),
               e2z = double(c.z) - double(a.z);
  const double sx = double(origin.x) - double(a.x), sy = double(origin.y) - double(a.y),
               sz = double(origin.z) - double(a.z);
  const double px = dy * e2z - dz * e2y, py = dz * e2x - dx * e2z, pz = dx * e2y - dy * e2x;
  const double qx = sy * e1z - sz * e1y, qy = sz * e1x - sx * e1z, qz = sx * e1y - sy * e1x;
  const double det = e1x * px + e1y * py + e1z * pz;
  const double o = at(origin, main_axis), d = at(direction, main_axis);
  const double za = double(at(a, main_axis)) - o, zb = double(at(b, main_axis)) - o,
               zc = double(at(c, main_axis)) - o;
  double t, u, v;
  if (det != 0.0) {
    const double inv = 1.0 / det;
    t = (e2x * qx + e2y * qy + e2z * qz) * inv;
    u = (sx * px + sy * py + sz * pz) * inv;
    v = (dx * qx + dy * qy + dz * qz) * inv;
  } else {
    const EdgeWeights e = edge_weights();
    const double inv = 1.0 / (e.u + e.v + e.w);
    u = e.v * inv;
    v = e.w * inv;
    t = (e.u * za + e.v * zb + e.w * zc) * inv / d;
  }
  // Also where the weights tell a point within the triangle: of a needle t is off by more than they are.
  const double low = za < zb ? (za < zc ? za : zc) : (zb < zc ? zb : zc);
  const double high = za > zb ? (za > zc ? za : zc) : (zb > zc ? zb : zc);
  const double z = t * d;
  if (!(z >= low)) t = low / d;
  if (z > high) t = high / d;
  // -0 becomes +0, so that equal results have equal bits.
  const float t_float = float(t) + 0.0f;
  if (!(t_float >= tmin && t_float <= tmax)) return false;
  float u_float = float(u), v_float = float(v);
  if (!(u_float > 0.0f)) u_float = 0.0f;
  if (!(v_float > 0.0f)) v_float = 0.0f;
  if (u_float > 1.0f) u_float = 1.0f;
  if (v_float > 1.0f - u_float) v_float = 1.0f - u_float;
  hit = {t_float, u_float, v_float};
  return true;
}

// True where the triangle is hit with t in [tmin, tmax], from either side.
template <EdgeRule Rule>
GPURT_INLINE bool intersect(const TriangleRay<TriangleTest::Watertight> &r, Vec3f a, Vec3f b, Vec3f c,
                            float tmin, float tmax, TriangleHit &hit)
{
  const ShearedPoint<float> sa = shear(r, a), sb = shear(r, b), sc = shear(r, c);
  const float u = edge_function(sc, sb), v = edge_function(sa, sc), w = edge_function(sb, sa);
  // Signs that are there are exact, so that two that differ settle it.
  if ((u < 0.0f || v < 0.0f || w < 0.0f) && (u > 0.0f || v > 0.0f || w > 0.0f)) return false;
  double eu = u, ev = v, ew = w;
  // A product that vanished, underflowed or overflowed: once more, where products are exact.
  if (!(u < 0.0f || u > 0.0f) || !(v < 0.0f || v > 0.0f) || !(w < 0.0f || w > 0.0f)) {
    const ShearedPoint<double> da = shear_exact(r, a, sa), db = shear_exact(r, b, sb),
                               dc = shear_exact(r, c, sc);
    eu = edge_function(dc, db);
    ev = edge_function(da, dc);
    ew = edge_function(db, da);
    if (!accept_edges<Rule>(da, db, dc, eu, ev, ew)) return false;
  }
  const auto weights = [&] { return EdgeWeights{eu, ev, ew}; };
  return measure_hit(r.origin, r.direction, r.kz, a, b, c, weights, tmin, tmax, hit);
}

template <EdgeRule Rule>
GPURT_INLINE bool intersect(const TriangleRay<TriangleTest::Double> &r, Vec3f a, Vec3f b, Vec3f c, float tmin,
                            float tmax, TriangleHit &hit)
{
  const ShearedPoint<double> sa = shear(r, a), sb = shear(r, b), sc = shear(r, c);
  // Here 0 means nearer to the edge than double can tell: such a point belongs to both sides, as one on the edge does.
  const double u = edge_function(sc, sb), v = edge_function(sa, sc), w = edge_function(sb, sa);
  if (!accept_edges<Rule>(sa, sb, sc, u, v, w)) return false;
  const auto weights = [&] { return EdgeWeights{u, v, w}; };
  return measure_hit(r.origin, r.direction, r.kz, a, b, c, weights, tmin, tmax, hit);
}

// In float throughout, and no constant that a determinant is compared with: it scales with the area.
// Source: Moeller and Trumbore 1997. Leaks where rounding puts a point outside of both triangles of an edge.
template <EdgeRule>
GPURT_INLINE bool intersect(const TriangleRay<TriangleTest::MollerTrumbore> &r, Vec3f a, Vec3f b, Vec3f c,
                            float tmin, float tmax, TriangleHit &hit)
{
  const Vec3f d = r.direction, e1 = b - a, e2 = c - a, s = r.origin - a;
  const Vec3f p = {d.y * e2.z - d.z * e2.y, d.z * e2.x - d.x * e2.z, d.x * e2.y - d.y * e2.x};
  const float det = e1.x * p.x + e1.y * p.y + e1.z * p.z;
  if (det == 0.0f) return false;
  const float u = s.x * p.x + s.y * p.y + s.z * p.z;
  const Vec3f q = {s.y * e1.z - s.z * e1.y, s.z * e1.x - s.x * e1.z, s.x * e1.y - s.y * e1.x};
  const float v = d.x * q.x + d.y * q.y + d.z * q.z;
  const bool inside =
      det > 0.0f ? (u >= 0.0f && v >= 0.0f && u + v <= det) : (u <= 0.0f && v <= 0.0f && u + v >= det);
  if (!inside) return false;
  const float t = (e2.x * q.x + e2.y * q.y + e2.z * q.z) / det + 0.0f;
  if (!(t >= tmin && t <= tmax)) return false;
  hit = {t, u / det + 0.0f, v / det + 0.0f};
  return true;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
