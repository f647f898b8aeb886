// Photons in flight on the device: queues that a step reads and writes anew without gaps, as a pool of paths has them.
// Photons of several passes fly together; each knows its pass by the number of its slot.
//
// Which photon takes which place in a queue or in the store depends on how blocks come; sums over photons are exact, so
// that no result does.
#pragma once

#include <cuda_runtime_api.h>

#include "core/photon/photon_wave.h"
#include "cuda/accel/kernels.h"
#include "cuda/photon/device_bounds.h"

namespace gpurt::cuda {

// What a photon carries from surface to surface.
struct alignas(16) FlyingPhoton {
  Vec3f flux;
  uint32_t id;    // within the pass
  uint64_t seed;  // the key of the photon's samples
  uint32_t reversed_index;
  uint32_t num_hits_and_slot;  // surfaces met so far; from bit slot_shift on the slot of the pass
};
static_assert(sizeof(FlyingPhoton) == 32);

struct PhotonQueue {
  FlyingPhoton *photons;
  Ray *rays;
  uint32_t *left_out;  // the triangle that a ray leaves and cannot meet; invalid_id: none
  uint32_t *media;     // as PhotonState::medium; null where nothing absorbs
};

// Photons keep the number of surfaces in a byte. Photon::bounce has the slot in the same bits.
constexpr uint32_t slot_shift = 8;
static_assert(max_photon_depth < 1u << slot_shift);

// What steps count, in device memory.
struct FlightNumbers {
  uint32_t next;        // photons that go on, of one step
  uint32_t missing;     // photons of the passes that carry nothing
  uint32_t stored;      // records of the map so far
  DeviceBounds bounds;  // of these
};

/// What all photons of passes that fly together share.
struct PhotonFlight {
  SceneView scene;
  EmissionView emission;     // in device memory
  const PhotonPass *passes;  // by slot, in device memory
  uint64_t seed;
  uint32_t frame_index, max_depth;
  uint32_t photons_per_pass;
  bool leaves_out;  // whether the rays' left_out is wanted
};

/// Photons first .. first + n - 1, counted through all passes, into places of the queue from `place` on. Those that carry nothing have rays
/// that meet nothing.
void launch_emit_photons(const PhotonFlight &flight, const PhotonQueue &queue, uint32_t first, uint32_t place,
                         uint32_t n, FlightNumbers *numbers, cudaStream_t stream);

/// What n photons leave behind, into records[numbers->stored ...], which has room for all of them and whose bounds grow by
/// theirs, and those that go on into `to`, numbers->next of them.
void launch_scatter_photons(const PhotonFlight &flight, const PhotonQueue &from, const Hit *hits, uint32_t n,
                            const PhotonQueue &to, Photon *records, FlightNumbers *numbers,
                            cudaStream_t stream);

}  // namespace gpurt::cuda
