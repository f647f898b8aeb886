// How kernels read rays and write hits: once each, in 16-byte pieces where addresses allow, past the caches that the
// tree and its triangles should keep.
#pragma once

#include "core/accel/hit_ids.h"
#include "cuda/launch.h"

namespace gpurt::cuda {

inline bool is_aligned_16(const void *p) { return (reinterpret_cast<uintptr_t>(p) & 15u) == 0; }

#if defined(__CUDACC__)

__device__ __forceinline__ Ray load_ray(const Ray *rays, uint64_t i, bool aligned)
{
  if (!aligned) return rays[i];
  const float4 *p = reinterpret_cast<const float4 *>(rays + i);
  const float4 a = __ldg(p), b = __ldg(p + 1);
  return {{a.x, a.y, a.z}, a.w, {b.x, b.y, b.z}, b.w};
}

__device__ __forceinline__ void store_hit(CompactHit *hits, uint64_t i, const CompactHit &hit, bool aligned)
{
  if (!aligned) {
    hits[i] = hit;
    return;
  }
  __stcs(reinterpret_cast<float4 *>(hits + i),
         make_float4(hit.t, hit.u, hit.v, __uint_as_float(hit.primitive)));
}

__device__ __forceinline__ void store_hit(FullHit *hits, uint64_t i, const FullHit &hit, bool aligned)
{
  if (!aligned) {
    hits[i] = hit;
    return;
  }
  float4 *p = reinterpret_cast<float4 *>(hits + i);
  __stcs(p, make_float4(hit.t, hit.u, hit.v, __uint_as_float(hit.primitive)));
  __stcs(p + 1, make_float4(__uint_as_float(hit.geometry), __uint_as_float(hit.instance), 0.0f, 0.0f));
}

#endif

}  // namespace gpurt::cuda
