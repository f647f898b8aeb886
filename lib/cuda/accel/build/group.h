// The threads that work on one node together, as the builder's algorithms see them: a block, a warp, or, on the host, where
// tests run the same algorithms, a single thread.
//
// Values that threads combine are minima, maxima and counts of integers: they do not depend on who comes first.
#pragma once

#include <bit>

#include "core/math/vec.h"
#include "cuda/warp_reduce.h"

#if defined(__CUDACC__)
#define GPURT_GROUP __device__ inline
#define GPURT_GROUP_MEMBER __device__
#define GPURT_GROUP_OUTLINE __device__ __noinline__ inline
#define GPURT_UNROLL _Pragma("unroll")
#else
#define GPURT_GROUP inline
#define GPURT_GROUP_MEMBER
#define GPURT_GROUP_OUTLINE inline
#define GPURT_UNROLL
#endif

namespace gpurt::cuda {

// A float as an integer of the same order, and back.
GPURT_GROUP int ordered_from_float(float x)
{
  const int bits = int(float_bits(x));
  return bits ^ ((bits >> 31) & 0x7fffffff);
}
GPURT_GROUP float float_from_ordered(int x)
{
  return float_from_bits(uint32_t(x ^ ((x >> 31) & 0x7fffffff)));
}

#if defined(__CUDACC__)

GPURT_GROUP void lower_to(int *target, int x) { atomicMin(target, x); }
GPURT_GROUP void raise_to(int *target, int x) { atomicMax(target, x); }
GPURT_GROUP void lower_to(uint64_t *target, uint64_t x)
{
  atomicMin(reinterpret_cast<unsigned long long *>(target), static_cast<unsigned long long>(x));
}
GPURT_GROUP void raise_to(uint32_t *target, uint32_t x) { atomicMax(target, x); }
GPURT_GROUP void set_bits(uint32_t *target, uint32_t x) { atomicOr(target, x); }
/// Returns the value before.
GPURT_GROUP uint32_t add_to(uint32_t *target, uint32_t x) { return atomicAdd(target, x); }
GPURT_GROUP uint32_t count_bits(uint32_t x) { return uint32_t(__popc(x)); }

constexpr unsigned warp_size = 32;

/// Every thread of a warp brings a value; the least goes into the target.
GPURT_GROUP void lower_by_warp(uint64_t *target, uint64_t x)
{
  for (unsigned step = warp_size / 2; step != 0; step /= 2) {
    const uint64_t other = __shfl_xor_sync(~0u, static_cast<unsigned long long>(x), step);
    x = other < x ? other : x;
  }
  if (threadIdx.x % warp_size == 0) lower_to(target, x);
}

class BlockGroup {
 public:
  /// `sums` is shared memory for as many values as the block has warps.
  __device__ explicit BlockGroup(uint32_t *sums) : sums_(sums) {}
  __device__ uint32_t thread() const { return threadIdx.x; }
  __device__ uint32_t size() const { return blockDim.x; }
  __device__ void sync() const { __syncthreads(); }
  /// The sum of the threads before this one, and of all. Every thread must come here.
  __device__ uint32_t scan(uint32_t x, uint32_t &total) const
  {
    const unsigned lane = threadIdx.x % warp_size, warp = threadIdx.x / warp_size;
    uint32_t sum = x;
    for (unsigned step = 1; step < warp_size; step *= 2) {
      const uint32_t other = __shfl_up_sync(~0u, sum, step);
      if (lane >= step) sum += other;
    }
    __syncthreads();  // sums_ may still be read
    if (lane == warp_size - 1) sums_[warp] = sum;
    __syncthreads();
    uint32_t before = 0;
    total = 0;
    for (unsigned w = 0; w < blockDim.x / warp_size; ++w) {
      if (w == warp) before = total;
      total += sums_[w];
    }
    return before + sum - x;
  }
  /// Every thread's value goes into the target. Every thread must come here.
  __device__ void lower_all(int *target, int x) const
  {
    x = warp_min(x);
    if (threadIdx.x % warp_size == 0) atomicMin(target, x);
  }
  __device__ void raise_all(int *target, int x) const
  {
    x = warp_max(x);
    if (threadIdx.x % warp_size == 0) atomicMax(target, x);
  }

 private:
  uint32_t *sums_;
};

class WarpGroup {
 public:
  __device__ uint32_t thread() const { return threadIdx.x % warp_size; }
  __device__ uint32_t size() const { return warp_size; }
  __device__ void sync() const { __syncwarp(); }
  __device__ uint32_t scan(uint32_t x, uint32_t &total) const
  {
    const unsigned lane = threadIdx.x % warp_size;
    uint32_t sum = x;
    for (unsigned step = 1; step < warp_size; step *= 2) {
      const uint32_t other = __shfl_up_sync(~0u, sum, step);
      if (lane >= step) sum += other;
    }
    total = __shfl_sync(~0u, sum, warp_size - 1);
    return sum - x;
  }
};

#else

GPURT_GROUP void lower_to(int *target, int x) { *target = min(*target, x); }
GPURT_GROUP void raise_to(int *target, int x) { *target = max(*target, x); }
GPURT_GROUP void lower_to(uint64_t *target, uint64_t x) { *target = min(*target, x); }
GPURT_GROUP void raise_to(uint32_t *target, uint32_t x) { *target = max(*target, x); }
GPURT_GROUP void set_bits(uint32_t *target, uint32_t x) { *target |= x; }
GPURT_GROUP uint32_t count_bits(uint32_t x) { return uint32_t(std::popcount(x)); }
GPURT_GROUP void lower_by_warp(uint64_t *target, uint64_t x) { lower_to(target, x); }
GPURT_GROUP uint32_t add_to(uint32_t *target, uint32_t x)
{
  const uint32_t before = *target;
  *target += x;
  return before;
}

class SerialGroup {
 public:
  uint32_t thread() const { return 0; }
  uint32_t size() const { return 1; }
  void sync() const {}
  uint32_t scan(uint32_t x, uint32_t &total) const
  {
    total = x;
    return 0;
  }
  void lower_all(int *target, int x) const { lower_to(target, x); }
  void raise_all(int *target, int x) const { raise_to(target, x); }
};

#endif

}  // namespace gpurt::cuda
