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

// Where a ray meets a triangle: t, and the weights of the second and third corner.
struct MeetingPoint {
  double t, u, v;
};

// The line y = 0 among sheared corners: where it crosses an edge, and the corners' weights there.
struct EdgeCrossing {
  double x;
  double weight[3];
};

// The weights of the corners at (0, 0), which lies between them or on the border: of the point on the line between where y = 0
// enters and where it leaves. Quotients are of numbers whose sum does not cancel, so that the point is on the ray, to few
// roundings of the corners, however thin the triangle is.
GPURT_HD inline MeetingPoint weights_at_ray(const ShearedPoint<double> (&p)[3])
{
  EdgeCrossing first = {infinity, {1.0, 0.0, 0.0}}, last = {-infinity, {1.0, 0.0, 0.0}};
  for (int i = 0; i < 3; ++i) {
    const int j = i == 2 ? 0 : i + 1;
    const double y = p[i].y, next = p[j].y;
    if ((y > 0.0 && next > 0.0) || (y < 0.0 && next < 0.0) || y == next) continue;
    const double share = y / (y - next);
    EdgeCrossing crossing = {p[i].x + share * (p[j].x - p[i].x), {0.0, 0.0, 0.0}};
    crossing.weight[i] = 1.0 - share;
    crossing.weight[j] = share;
    if (crossing.x < first.x) first = crossing;
    if (crossing.x > last.x) last = crossing;
  }
  double share = first.x < 0.0 ? first.x / (first.x - last.x) : 0.0;
  if (!(share < 1.0)) share = 1.0;  // last.x is at most 0
  const auto weight = [&](int i) { return first.weight[i] + share * (last.weight[i] - first.weight[i]); };
  return {0.0, weight(1), weight(2)};
}

// Of a triangle that a test says is hit, and of which the plane or the weights may say otherwise: `point` stays as it is where
// the ray's point at t and the triangle's, by weights cut to it, are one but for rounding. Else it becomes the point where the
// ray passes between the `sheared` corners.
GPURT_OUTLINE void settle_meeting_point(Vec3f origin, Vec3f direction, int main_axis, Vec3f a, Vec3f b,
                                        Vec3f c, const ShearedPoint<double> (&sheared)[3],
                                        MeetingPoint &point)
{
  const double o = at(origin, main_axis), d = at(direction, main_axis);
  const double za = double(at(a, main_axis)) - o, zb = double(at(b, main_axis)) - o,
               zc = double(at(c, main_axis)) - o;
  const double low = za < zb ? (za < zc ? za : zc) : (zb < zc ? zb : zc);
  const double high = za > zb ? (za > zc ? za : zc) : (zb > zc ? zb : zc);
  const auto cut = [](double x, double from, double to) { return x < from ? from : x > to ? to : x; };
  const double t = cut(point.t * d, low, high) / d, u = cut(point.u, 0.0, 1.0),
               v = cut(point.v, 0.0, 1.0 - u);
  double farthest = 0.0, distance = 0.0;
  bool is_number = true;
  for (int k = 0; k < 3; ++k) {
    const double from = at(origin, k), pa = double(at(a, k)) - from, pb = double(at(b, k)) - from,
                 pc = double(at(c, k)) - from;
    const double off = (pa + u * (pb - pa) + v * (pc - pa)) - t * double(at(direction, k));
    const double largest = abs(pa) > abs(pb) ? abs(pa) : abs(pb);
    farthest = largest > farthest ? largest : farthest;
    farthest = abs(pc) > farthest ? abs(pc) : farthest;
    distance = abs(off) > distance ? abs(off) : distance;
    is_number = is_number && off == off;
  }
  if (is_number && distance <= 0x1p-22 * farthest) return;
  point = weights_at_ray(sheared);
  point.t = (za + point.u * (zb - za) + point.v * (zc - za)) / d;
}

// Where the ray meets a triangle that it was found to meet: t, u and v in double, rounded once.
//
// Coordinates are floats, so that a plane seen at an angle of 1e-3 through a needle of 1e5:1 still gives t to half an ulp of a
// float. But a test takes a ray for one that meets the triangle, too, where it passes outside by no more than the test's
// rounding, and there the plane may be met far from the triangle; edge-on it says nothing. What has to hold, so that a hit is
// found where its t is, whatever the tree and in whichever order its leaves are visited: with eps = 2^-24 and M the largest
// |p - o| of a corner along an axis, the ray's point at t is within 8 eps M of a point of the triangle, along each axis. Of
// these one is for rounding t to float, and 7 are as in kd_traverse.h.
//
// It holds of the plane's point if its weights are those of a point of the triangle and det is not made of roundings. With S
// the largest |o - a| along an axis, E and F those of the edges and D that of the direction, numerators and det are off by at
// most 50 * 2^-53 of their factors' product, so that t D, u E and v F are off by no more than 2^-45 S D E F / |det|, of which
// we ask for eps / 8 S. Else settle(point) is called, which sees to it: settle_meeting_point().
// Source: Moeller and Trumbore 1997 for the formula.
template <class Settle>
GPURT_HD inline bool measure_hit(Vec3f origin, Vec3f direction, int main_axis, Vec3f a, Vec3f b, Vec3f c,
                                 Settle &&settle, float tmin, float tmax, TriangleHit &hit)
{
  const float d = at(direction, main_axis);
  const auto extent = [](Vec3f e) { return at_least(larger_size(e.x, e.y), size_of(e.z)); };
  const float rounding = extent(b - a) * extent(c - a) * size_of(d) * 0x1p-18f;
  const float za = at(a, main_axis), zb = at(b, main_axis), zc = at(c, main_axis), o = at(origin, main_axis);
  const float z_low = at_most(za, at_most(zb, zc)), z_high = at_least(za, at_least(zb, zc));
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
  const double inv = 1.0 / det;
  MeetingPoint point = {(e2x * qx + e2y * qy + e2z * qz) * inv, (sx * px + sy * py + sz * pz) * inv,
                        (dx * qx + dy * qy + dz * qz) * inv};
  const float size = size_of(float(det));
  // Products may have lost bits below 2^-100; infinity is no more than itself.
  const bool is_told = size > rounding && size > 0x1p-100f && point.u >= -0x1p-30 && point.v >= -0x1p-30 &&
                       point.u + point.v <= 1.0 + 0x1p-30;
  if (!is_told) settle(point);
  // What is left of rounding: t is that of a point within the triangle's extent along the main axis.
  const double z = point.t * double(d), low = double(z_low) - double(o), high = double(z_high) - double(o);
  if (!(z >= low)) point.t = low / double(d);
  if (z > high) point.t = high / double(d);
  // -0 becomes +0, so that equal results have equal bits.
  const float t_float = float(point.t) + 0.0f;
  if (!(t_float >= tmin && t_float <= tmax)) return false;
  float u_float = float(point.u), v_float = float(point.v);
  if (!(u_float > 0.0f)) u_float = 0.0f;
  if (!(v_float > 0.0f)) v_float = 0.0f;
  if (u_float > 1.0f) u_float = 1.0f;
  if (v_float > 1.0f - u_float) v_float = 1.0f - u_float;
  hit = {t_float, u_float, v_float};
  return true;
}

// The hit of a triangle that the edge functions have told to be hit.
GPURT_INLINE bool measure_accepted(const TriangleRay<TriangleTest::Watertight> &r, Vec3f a, Vec3f b, Vec3f c,
                                   float tmin, float tmax, TriangleHit &hit)
{
  const auto settle = [&](MeetingPoint &point) {
    const ShearedPoint<double> sheared[3] = {shear_exact(r, a, shear(r, a)), shear_exact(r, b, shear(r, b)),
                                             shear_exact(r, c, shear(r, c))};
    settle_meeting_point(r.origin, r.direction, r.kz, a, b, c, sheared, point);
  };
  return measure_hit(r.origin, r.direction, r.kz, a, b, c, settle, tmin, tmax, hit);
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
  // A product that vanished, underflowed or overflowed: once more, where products are exact.
  if (!(u < 0.0f || u > 0.0f) || !(v < 0.0f || v > 0.0f) || !(w < 0.0f || w > 0.0f)) {
    const ShearedPoint<double> da = shear_exact(r, a, sa), db = shear_exact(r, b, sb),
                               dc = shear_exact(r, c, sc);
    if (!accept_edges<Rule>(da, db, dc, edge_function(dc, db), edge_function(da, dc), edge_function(db, da)))
      return false;
  }
  return measure_accepted(r, a, b, c, tmin, tmax, hit);
}

template <EdgeRule Rule>
GPURT_INLINE bool intersect(const TriangleRay<TriangleTest::Double> &r, Vec3f a, Vec3f b, Vec3f c, float tmin,
                            float tmax, TriangleHit &hit)
{
  const ShearedPoint<double> sa = shear(r, a), sb = shear(r, b), sc = shear(r, c);
  // Here 0 means nearer to the edge than double can tell: such a point belongs to both sides, as one on the edge does.
  const double u = edge_function(sc, sb), v = edge_function(sa, sc), w = edge_function(sb, sa);
  if (!accept_edges<Rule>(sa, sb, sc, u, v, w)) return false;
  const auto settle = [&](MeetingPoint &point) {
    const ShearedPoint<double> sheared[3] = {sa, sb, sc};
    settle_meeting_point(r.origin, r.direction, r.kz, a, b, c, sheared, point);
  };
  return measure_hit(r.origin, r.direction, r.kz, a, b, c, settle, tmin, tmax, hit);
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
