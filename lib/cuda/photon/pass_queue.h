// What the parts of a photon mapping pass share: the scene, a stream, and how rays of a queue are traced.
#pragma once

#include <atomic>

#include "cuda/accel/near.h"
#include "cuda/accel/ray_slices.h"
#include "cuda/photon/lap_clock.h"

namespace gpurt::cuda {

/// One stream of passes; everything that is queued goes on it.
struct PassQueue {
  const TraceScene &scene;
  std::shared_ptr<DeviceMemory> memory;
  cudaStream_t stream;
  std::byte *numbers;                  // pinned_bytes of host memory for what travels: see below
  const std::atomic<bool> *cancelled;  // or null
  LapClock clock;
  RaySlices slices;

  // Where the photons' numbers, those of eye paths, and what passes are made with go in it.
  static constexpr uint64_t eye_numbers = 256, passes = 512, pinned_bytes = 4096;

  bool has_near() const { return has_near_kernels_for_paths(scene); }
  bool is_cancelled() const { return cancelled != nullptr && cancelled->load(std::memory_order_relaxed); }
  void mark(PhotonLap lap) { clock.mark(stream, lap); }

  /// Closest hits of n rays; `left_out` may be null.
  void trace(const Ray *rays, uint32_t n, Hit *hits, Coherence coherence, const uint32_t *left_out,
             uint32_t *scratch)
  {
    slices.run(*scene.slices, n, stream, [&](uint64_t first, uint64_t count) {
      RayOrder order;
      if (has_near())
        order = {coherence, 0, scratch, left_out != nullptr ? left_out + first : nullptr, nullptr};
      launch_closest(scene, rays + first, count, HitLayout::Internal, hits + first, order, stream);
    });
  }

  /// Whether something stands in the way of n rays; `left_out` and `ended_at` may be null.
  void trace_any(const Ray *rays, uint32_t n, uint8_t *occluded, Coherence coherence,
                 const uint32_t *left_out, const uint32_t *ended_at, uint32_t *scratch)
  {
    slices.run(*scene.slices, n, stream, [&](uint64_t first, uint64_t count) {
      RayOrder order;
      if (has_near())
        order = {coherence, 0, scratch, left_out != nullptr ? left_out + first : nullptr,
                 ended_at != nullptr ? ended_at + first : nullptr};
      launch_any(scene, rays + first, count, occluded + first, order, stream);
    });
  }
};

}  // namespace gpurt::cuda
