// A ray's way through a kd-tree by nodes of two levels, step by step, as the fast kernels go it.
#pragma once

#include "core/accel/kd_quad.h"
#include "cuda/accel/near_lane.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

#if defined(__CUDACC__)

struct QuadWalk {
  using Kind = NearKind<false>;
  static constexpr int plain_blocks = 9, refill_blocks = 8;
  static constexpr int steps = 2, stepping_until = 12;

  // What a ray leaves for later, and the end below it: where it goes on, and the interval there.
  using Entry = uint4;
  static constexpr unsigned stack_size = kd_max_depth + 1;
  // The axes of a warp's rays by the bits of a plane's word: in shared memory, since registers cannot be indexed.
  struct alignas(1024) Shared {
    float2 axis[4][warp_size];
  };

  NearRay ray;  // but for what boxes are clipped with
  Entry *entries;
  unsigned top;
  uint32_t current;
  float a, b, width;  // of KdQuadRay
  uint32_t axes;      // of this lane: an address in shared memory, which is not computed anew every step
  uint32_t last;      // the triangle tested last: it may lie in the next leaf as well

  __device__ __forceinline__ QuadWalk(Entry *stack, Shared *shared, unsigned lane)
      : ray{}, entries(stack), top(1), current(kd_quad_end), a(0), b(0), width(0), last(invalid_id)
  {
    axes = uint32_t(__cvta_generic_to_shared(&shared->axis[0][lane]));
    asm volatile("" : "+r"(axes));
    entries[0] = make_uint4(kd_quad_end, __float_as_uint(-1.0f), __float_as_uint(-1.0f), 0);
  }

  __device__ __forceinline__ bool has_ended() const { return current == kd_quad_end; }
  __device__ __forceinline__ bool is_at_leaf() const { return int(current) < 0; }
  __device__ __forceinline__ void stop() { current = kd_quad_end; }
  __device__ __forceinline__ bool is_between_trees() const { return false; }
  // To what was left and begins before `end`, or the end.
  __device__ __forceinline__ void pop(float end)
  {
    uint4 e;
    do {
      --top;
      e = entries[top];
    } while (__uint_as_float(e.y) > end);
    a = __uint_as_float(e.y);
    b = at_most(__uint_as_float(e.z), end);
    current = e.x;
  }

  __device__ __forceinline__ bool begin(const TraceScene &s, const Ray &r, Entry *)
  {
    KdQuadRay q;
    if (!make_kd_quad_ray(r, s.kd_quads, ray, q)) return false;
    for (int k = 0; k < 4; ++k) set_axis(k, make_float2(q.axis[k].scale, q.axis[k].shift));
    a = q.a;
    b = q.b;
    width = q.width;
    restart(s);
    return true;
  }
  __device__ __forceinline__ void restart(const TraceScene &s)
  {
    top = 1;
    last = invalid_id;
    current = a <= b ? s.kd_quads.root : kd_quad_end;
  }

  // The axis's bits in a plane's word are its offset.
  __device__ __forceinline__ KdQuadAxis axis_of(uint32_t word) const
  {
    static_assert(sizeof(float2) * warp_size == 0x100);
    KdQuadAxis axis;
    asm volatile("ld.shared.v2.f32 {%0, %1}, [%2];"
                 : "=f"(axis.scale), "=f"(axis.shift)
                 : "r"(axes | (word & 0x300u)));
    return axis;
  }
  __device__ __forceinline__ void set_axis(uint32_t k, float2 axis)
  {
    asm volatile("st.shared.v2.f32 [%0], {%1, %2};" ::"r"(axes | k << 8), "f"(axis.x), "f"(axis.y)
                 : "memory");
  }

  __device__ __forceinline__ static KdQuadNode load_quad(const KdQuadNode *nodes, uint32_t current)
  {
    // Shifted by the size of a node, the bits above the index are gone.
    static_assert(sizeof(KdQuadNode) == 16 && kd_quad_index == ~0u >> 4);
    const uint4 n = __ldg(
        reinterpret_cast<const uint4 *>(reinterpret_cast<const char *>(nodes) + uint32_t(current << 4)));
    return {{n.x, n.y, n.z, n.w}};
  }

  struct Push {
    QuadWalk &walk;
    __device__ __forceinline__ void push(uint32_t w, float a, float b)
    {
      walk.entries[walk.top] = make_uint4(w, __float_as_uint(a), __float_as_uint(b), 0);
      ++walk.top;
    }
  };

  template <bool>
  __device__ __forceinline__ void step(const TraceScene &s, float end)
  {
    count_step();
    const KdQuadNode node = load_quad(s.kd_quads.nodes, current);
    Push push{*this};
    if (!kd_quad_step(node, [&](uint32_t word) { return axis_of(word); }, width, current, a, b, push))
      pop(end);
  }

  // Calls test(triangle, what it is known by, its reference) for the triangles of a leaf, until it returns true.
  template <class Test>
  __device__ __forceinline__ bool test_leaf(const TraceScene &s, Test &&test)
  {
    KdQuadNode node = load_quad(s.kd_quads.nodes, current);
    const uint32_t count = node.word[0];
    const uint32_t *references = s.kd_quads.references + node.word[1];
    for (uint32_t k = 0; k < count; ++k) {
      count_step();
      uint32_t place = node.word[1];
      if (count > kd_quad_inline_triangles) {
        place = __ldg(references + k);
      } else {
        node.word[1] = node.word[2];
        node.word[2] = node.word[3];
      }
      if (place == last) continue;
      last = place;
      if (test(load_triangle(s.kd_quads.triangles, place), place, place)) return true;
    }
    return false;
  }

  // As in BvhWalk; where the ray is in the bounds is kept.
  struct Waiting {
    float a[warp_size], b[warp_size];
  };
  __device__ __forceinline__ static bool start(const TraceScene &s, const Ray &from, NearRay &r, NearBegin &n)
  {
    return start_near_ray(from, s.kd_quads.frame, s.kd_quads.frame.reach, r, n);
  }
  __device__ __forceinline__ static void keep(const TraceScene &s, const Ray &from, NearRay &r, NearBegin &n,
                                              Waiting &waiting, unsigned lane)
  {
    begin_near_ray(from.tmin, kd_quad_t_share, r, n);
    clip_to_bounds(from, s.kd_quads, r, n, waiting.a[lane], waiting.b[lane]);
  }
  __device__ __forceinline__ static Vec3f center(const TraceScene &s) { return s.kd_quads.frame.center; }
  __device__ __forceinline__ void take(const TraceScene &s, float tmin, NearBegin &n, const Waiting &waiting,
                                       unsigned slot, Entry *)
  {
    begin_near_ray(tmin, kd_quad_t_share, ray, n);
    const float unit = kd_quad_unit(s.kd_quads.frame);
    for (int k = 0; k < 3; ++k) {
      const KdQuadAxis axis = kd_quad_axis_of(at(ray.inverse, k), at(n.offset, k), unit, n);
      set_axis(k, make_float2(axis.scale, axis.shift));
    }
    set_axis(3, make_float2(0.0f, infinity));
    a = waiting.a[slot];
    b = waiting.b[slot];
    width = kd_quad_width(unit, n);
    restart(s);
  }
};

#endif

GPURT_KERNELS_END
}  // namespace gpurt::cuda
