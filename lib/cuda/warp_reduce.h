// Sums, extremes and unions of a value of every lane of a warp, for all of them to have. All lanes must come here.
//
// One instruction from compute capability 8.0 on, five steps of exchanges below it. T is int or uint32_t.
#pragma once

#include <cstdint>

#if defined(__CUDACC__)

namespace gpurt::cuda {

template <class T, class Combine>
__device__ __forceinline__ T combine_lanes(T x, Combine &&combine)
{
  for (unsigned step = 16; step != 0; step /= 2) x = combine(x, __shfl_xor_sync(~0u, x, step));
  return x;
}

template <class T>
__device__ __forceinline__ T warp_sum(T x)
{
#if __CUDA_ARCH__ >= 800
  return T(__reduce_add_sync(~0u, x));
#else
  return combine_lanes(x, [](T a, T b) { return T(a + b); });
#endif
}

template <class T>
__device__ __forceinline__ T warp_min(T x)
{
#if __CUDA_ARCH__ >= 800
  return T(__reduce_min_sync(~0u, x));
#else
  return combine_lanes(x, [](T a, T b) { return b < a ? b : a; });
#endif
}

template <class T>
__device__ __forceinline__ T warp_max(T x)
{
#if __CUDA_ARCH__ >= 800
  return T(__reduce_max_sync(~0u, x));
#else
  return combine_lanes(x, [](T a, T b) { return b > a ? b : a; });
#endif
}

__device__ __forceinline__ uint32_t warp_or(uint32_t x)
{
#if __CUDA_ARCH__ >= 800
  return __reduce_or_sync(~0u, x);
#else
  return combine_lanes(x, [](uint32_t a, uint32_t b) { return a | b; });
#endif
}

}  // namespace gpurt::cuda

#endif
