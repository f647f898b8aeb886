// A ray as the bvh's fast kernels carry it: fewer operations a box and a triangle than traverse_bvh and intersect, and the
// same hits to the bit.
//
// It serves rays of the watertight test whose origin is near the tree: boxes are stored larger by what rounding takes up
// to there, so that a box needs no widening of its own. Other rays, which are few, go the general way; or, where trees are small
// beside the scene that they are placed in, as far rays, whose boxes are widened on the way.
//
// In the terms of bvh_traverse.h, with M no more than half of the frame's reach, boxes are larger by 20 eps M on each side. Of
// these 8 eps M are the triangle test's; 7 those of the box test's roundings with a reciprocal that is off by 1 ulp; and 3 those of
// taking tmin, of at most M/|d_z|, from every distance: three sums are rounded, each by eps of what it then has of tmin.
// Boxes of far rays are widened by 24 eps M: as much, and what rounding the sum of a half extent and that takes, eps M.
#pragma once

#include "core/accel/bvh_traverse.h"
#include "core/accel/kd_accel.h"

namespace gpurt {

struct NearRay {
  Vec3f inverse, shift, size;  // 1/d, -o'/d - begin and |1/d|
  Vec3f origin;
  float sx, sy, sz;  // the shear
  int main_axis;
  float
      end_offset;  // of a t of the ray, widened: what boxes are compared with is t - begin, so that it is not negative
};

// An interval that holds the t which intersect() gives for a triangle, whatever rounding did to both.
struct HitInterval {
  float lower, upper;
};

// What the edge functions say of a triangle in single precision. Unclear: intersect() has to tell.
enum class EdgeVerdict { Outside, Inside, Unclear };

GPURT_FUNCTIONS_BEGIN

#if defined(__CUDA_ARCH__)
// Off by 1 ulp. What is too small to be normal gives infinity; arguments are below 2^104.
GPURT_INLINE float fast_reciprocal(float x)
{
  float r;
  asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(r) : "f"(x));
  return r;
}
// 1/x as it is rounded, of x that are neither too large nor too small for 1/x to be normal: what division does for these, without
// looking whether x is one.
GPURT_INLINE float normal_reciprocal(float x)
{
  const float r = fast_reciprocal(x);
  return fma(r, -fma(x, r, -1.0f), r);
}
// Of three floats, and a fourth, as integers, which takes half the instructions: integers order positive floats as floats
// do, and negative ones below them, the other way round. The maximum with 0 is exact; a minimum below 0 stays below 0. What
// is not a number counts as very large.
GPURT_INLINE float loose_max(float a, float b, float c, float d)
{
  return __int_as_float(
      max(__vimax3_s32(__float_as_int(a), __float_as_int(b), __float_as_int(c)), __float_as_int(d)));
}
GPURT_INLINE float loose_min(float a, float b, float c, float d)
{
  return __int_as_float(
      min(__vimin3_s32(__float_as_int(a), __float_as_int(b), __float_as_int(c)), __float_as_int(d)));
}
#else
GPURT_INLINE float fast_reciprocal(float x) { return 1.0f / x; }
GPURT_INLINE float normal_reciprocal(float x) { return 1.0f / x; }
GPURT_INLINE float loose_max(float a, float b, float c, float d)
{
  return at_least(at_least(at_least(d, a), b), c);
}
GPURT_INLINE float loose_min(float a, float b, float c, float d)
{
  return at_most(at_most(at_most(d, a), b), c);
}
#endif

// As abs() and max_component(), in half the instructions of a GPU; a component that is not a number may be missed.
GPURT_INLINE Vec3f sizes_of(Vec3f v) { return {size_of(v.x), size_of(v.y), size_of(v.z)}; }
GPURT_INLINE float largest_of(Vec3f v) { return at_least(at_least(v.x, v.y), v.z); }

// Puts the main axis in the place of z, and z in its place. intersect() turns all three axes, by which x and y may change places
// as well: edge functions then have the same bits but for a common sign.
GPURT_INLINE Vec3f main_axis_to_z(Vec3f v, int axis)
{
  const bool is_x = axis == 0, is_y = axis == 1;
  return {is_x ? v.z : v.x, is_y ? v.z : v.y, is_x ? v.x : is_y ? v.y : v.z};
}

// What a ray has in common with all trees that it may be near.
struct NearBegin {
  Vec3f offset;  // of the origin from the frame's centre
  float
      farthest;  // the largest distance from the origin to a point of the tree, along an axis, or a little more
  float begin;  // what distances are counted from: tmin, less what is left to rounding
};

// False for a ray that has to go the general way, misses among them, or from farther away than half of `reach`. Left to the
// caller are where distances begin, and the axes.
GPURT_INLINE bool start_near_ray(const Ray &ray, const BvhFrame &frame, float reach, NearRay &r, NearBegin &n)
{
  const Vec3f magnitude = sizes_of(ray.direction);
  const float largest = largest_of(magnitude);
  n.offset = ray.origin - frame.center;
  const Vec3f distance = sizes_of(n.offset);
  n.farthest = largest_of(distance) + frame.half_extent;
  // Not a number if one of them is none, which comparisons of the largest may miss.
  const float sum = (magnitude.x + magnitude.y + magnitude.z) + (distance.x + distance.y + distance.z);
  if (!(largest >= 0x1p-40f && largest <= 0x1p40f && sum < infinity && 2.0f * n.farthest <= reach &&
        ray.tmin <= ray.tmax && abs(ray.tmin) * largest <= n.farthest))
    return false;
  r.main_axis = main_axis_of(ray.direction);
  const Vec3f turned = main_axis_to_z(ray.direction, r.main_axis);
  r.sz = normal_reciprocal(turned.z);
  r.sx = turned.x * r.sz;
  r.sy = turned.y * r.sz;
  r.origin = ray.origin;
  const float limit = abs(r.sz) * 0x1p30f;
  const auto invert = [&](float d) { return copysign(at_most(limit, size_of(fast_reciprocal(d))), d); };
  r.inverse = {invert(ray.direction.x), invert(ray.direction.y), invert(ray.direction.z)};
  return true;
}

// `t_share` is of `farthest`, and is what t may be off by in units of the largest |1/d|.
constexpr float bvh_t_share = 0x1p-20f, kd_quad_t_share = 0x1p-18f;
GPURT_INLINE void begin_near_ray(float tmin, float t_share, NearRay &r, NearBegin &n)
{
  const float t_widening = n.farthest * t_share * abs(r.sz) + 0x1p-146f;
  n.begin = tmin - t_widening;
  r.end_offset = t_widening - n.begin;
}

// The axes of a bvh's boxes.
GPURT_INLINE void clip_from(float tmin, NearRay &r, NearBegin &n)
{
  begin_near_ray(tmin, bvh_t_share, r, n);
  r.size = sizes_of(r.inverse);
  const auto shift = [&](float o, float inverse) { return -(o * inverse) - n.begin; };
  r.shift = {shift(n.offset.x, r.inverse.x), shift(n.offset.y, r.inverse.y), shift(n.offset.z, r.inverse.z)};
}

GPURT_INLINE bool start_near_ray(const Ray &ray, const BvhView &tree, NearRay &r, NearBegin &n)
{
  return start_near_ray(ray, tree.frame, tree.frame.reach, r, n);
}
GPURT_INLINE bool make_near_ray(const Ray &ray, const BvhView &tree, NearRay &r)
{
  NearBegin n;
  if (!start_near_ray(ray, tree, r, n)) return false;
  clip_from(ray.tmin, r, n);
  return true;
}

// The same from farther away; half extents of boxes are taken larger by `widening`.
GPURT_INLINE bool start_far_ray(const Ray &ray, const BvhView &tree, NearRay &r, NearBegin &n)
{
  // As far as the largest trees' near rays, so that no product overflows that does not with these.
  return tree.frame.reach > 0.0f && start_near_ray(ray, tree.frame, 0x1p49f, r, n);
}
GPURT_INLINE float far_widening(const BvhView &tree, float farthest)
{
  return 2.0f * farthest <= tree.frame.reach ? 0.0f : farthest * 0x1.8p-20f;
}
GPURT_INLINE bool make_far_ray(const Ray &ray, const BvhView &tree, NearRay &r, float &widening)
{
  NearBegin n;
  if (!start_far_ray(ray, tree, r, n)) return false;
  clip_from(ray.tmin, r, n);
  widening = far_widening(tree, n.farthest);
  return true;
}

// Rays that wait have the axis that they are sheared onto in the lowest bits of `farthest`, which may be a little more.
GPURT_INLINE float with_axis(float farthest, int axis)
{
  return float_from_bits(((float_bits(farthest) + 4u) & ~3u) | uint32_t(axis));
}
GPURT_INLINE int axis_in(float farthest) { return int(float_bits(farthest) & 3u); }

GPURT_INLINE void clip_near(const NearRay &r, Vec3f center, float half_x, float half_y, float half_z,
                            float end, float &enter, float &leave)
{
  const float x = fma(center.x, r.inverse.x, r.shift.x), y = fma(center.y, r.inverse.y, r.shift.y),
              z = fma(center.z, r.inverse.z, r.shift.z);
  enter = loose_max(fma(-half_x, r.size.x, x), fma(-half_y, r.size.y, y), fma(-half_z, r.size.z, z), 0.0f);
  leave = loose_min(fma(half_x, r.size.x, x), fma(half_y, r.size.y, y), fma(half_z, r.size.z, z), end);
}

// The fast half of intersect(): the same edge functions, and instead of t an interval for it, in single precision.
GPURT_INLINE EdgeVerdict test_near(const NearRay &r, Vec3f a, Vec3f b, Vec3f c, HitInterval &t)
{
  const auto shear = [&](Vec3f p, float &z) {
    const Vec3f q = main_axis_to_z(p - r.origin, r.main_axis);
    z = q.z;
    return ShearedPoint<float>{q.x - r.sx * q.z, q.y - r.sy * q.z};
  };
  float za, zb, zc;
  const ShearedPoint<float> sa = shear(a, za), sb = shear(b, zb), sc = shear(c, zc);
  const float u = edge_function(sc, sb), v = edge_function(sa, sc), w = edge_function(sb, sa);
  const float least = at_most(u, at_most(v, w)), most = at_least(u, at_least(v, w));
  if (least < 0.0f && most > 0.0f) return EdgeVerdict::Outside;
  if (!(least > 0.0f || most < 0.0f)) return EdgeVerdict::Unclear;
  // Let C be the largest sheared coordinate, Z the largest and H the extent of the distances z along the main axis, D the
  // sum of the edge functions, eps = 2^-24. sx and sy are those of a direction that is off by 2 eps, which turns the ray
  // about its origin and moves the crossing by 2 eps Z. Apart from that, sheared coordinates are off by at most
  // 2 C + 3 Z times eps, which moves each edge function by at most 12 eps (C + Z) C, and rounding moves it by 4 eps C^2
  // more. So z, the mean of the corners' weighed by the edge functions, is off by s H with s = 48 eps (C + Z) C / |D|, or
  // by s / (1 - s) H where that moves D itself: by less than 4/3 s H for s below 3/16. It is never off by more than H,
  // since it and what intersect() gives both lie within the corners'. Roundings of z, of the mean and of t and the turn
  // are less than 15 eps (C + Z). What intersect() itself is off by, in double, is 2^-29 of that, eps/8 (C + Z) or less than H.
  const float z_low = at_most(za, at_most(zb, zc)), z_high = at_least(za, at_least(zb, zc));
  const float C =
      at_least(at_least(larger_size(sa.x, sa.y), larger_size(sb.x, sb.y)), larger_size(sc.x, sc.y));
  const float reach = C + larger_size(z_low, z_high);
  const float area = u + v + w;
  if (!(abs(area) >= 0x1p-80f)) return EdgeVerdict::Unclear;  // products may have lost bits
  const float inverse = fast_reciprocal(area);
  const float z = (u * za + v * zb + w * zc) * inverse;
  const float share = reach * (C * abs(inverse)) * 0x1p-18f;  // 64 eps
  const float error = (z_high - z_low) * (share <= 0.25f ? share : 1.0f) + reach * 0x1p-20f;
  const float t_error = error * abs(r.sz) + 0x1p-140f, t_middle = z * r.sz;
  t = {t_middle - t_error, t_middle + t_error};
  return EdgeVerdict::Inside;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
