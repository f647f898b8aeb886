// Places for the rays that are there: the techniques that the talk compares, each of which numbers the ones among n flags.
#pragma once

#include <cuda_runtime_api.h>

#include "core/path/path_wave.h"
#include "schedule.h"

namespace gpurt::cuda {

/// Memory of a placement of up to n items.
uint64_t placement_bytes(Compaction method, uint32_t n);

/// The items of a queue or a list of hits, as `flags` [n] of 0 or 1 in device memory.
struct Placement {
  Compaction method;
  void *memory;  // placement_bytes(method, n)
  uint64_t memory_bytes;
  uint32_t *flags;  // a naive scan overwrites them
};

/// flags[i] = whether rays[i] is there.
void launch_flag_rays(const Ray *rays, uint32_t n, uint32_t *flags, cudaStream_t stream);

/// Writes places[i], the number of ones before i, for every i whose flag is 1, and their number to `total`, which lies in
/// memory that the device and, if pinned, the host can see.
void launch_place(const Placement &placement, uint32_t n, uint32_t *places, uint32_t *total,
                  cudaStream_t stream);

// The techniques.
uint64_t block_scan_bytes(uint32_t n);
void launch_place_by_block_scan(const uint32_t *flags, uint32_t n, void *memory, uint32_t *places,
                                uint32_t *total, cudaStream_t stream);
uint64_t pyramid_bytes(uint32_t n);
void launch_place_by_pyramid(const uint32_t *flags, uint32_t n, void *memory, uint32_t *places,
                             uint32_t *total, cudaStream_t stream);
uint64_t naive_scan_bytes(uint32_t n);
void launch_place_by_naive_scan(uint32_t *flags, uint32_t n, void *memory, uint32_t *places, uint32_t *total,
                                cudaStream_t stream);
uint64_t library_scan_bytes(uint32_t n);
void launch_place_by_library_scan(const uint32_t *flags, uint32_t n, void *memory, uint64_t memory_bytes,
                                  uint32_t *places, uint32_t *total, cudaStream_t stream);

/// Moves the items whose rays are there to their places.
void launch_move_rays(const RayQueue &from, uint32_t n, const RayQueue &to, const uint32_t *places,
                      cudaStream_t stream);
void launch_move_shadows(const ShadowQueue &from, uint32_t n, const ShadowQueue &to, const uint32_t *places,
                         cudaStream_t stream);

}  // namespace gpurt::cuda
