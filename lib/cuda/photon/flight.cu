// Emission and scattering of photons.
#include "cuda/launch.h"
#include "cuda/path/pool_places.h"
#include "cuda/photon/flight.h"

namespace gpurt::cuda {
namespace {

__global__ void __launch_bounds__(block_size)
    emit_kernel(const __grid_constant__ PhotonFlight flight, const __grid_constant__ PhotonQueue queue,
                uint32_t first, uint32_t place, uint32_t n, FlightNumbers *numbers)
{
  const uint64_t i = thread_item();
  bool is_missing = false;
  if (i < n) {
    const uint32_t number = first + uint32_t(i), to = place + uint32_t(i);
    const uint32_t slot = number / flight.photons_per_pass, id = number - slot * flight.photons_per_pass;
    const SampleKey key =
        photon_key(flight.seed, flight.frame_index, flight.passes[slot].index, flight.photons_per_pass, id);
    EmittedPhoton photon{};
    is_missing = !emit_photon(flight.scene, flight.emission, key, photon);
    if (is_missing) {
      photon.ray = {vec3(0.0f), 0.0f, vec3(0.0f), -1.0f};
      photon.triangle = invalid_id;
    }
    queue.photons[to] = {photon.flux, id, key.seed, key.reversed_index, slot << slot_shift};
    store_ray(queue.rays + to, photon.ray);
    queue.left_out[to] = flight.leaves_out && photon.triangle != invalid_id
                             ? leave_out(flight.scene, photon.ray, photon.triangle)
                             : invalid_id;
    if (queue.media != nullptr) queue.media[to] = medium_air;
  }
  const int num_missing = __syncthreads_count(is_missing);
  if (threadIdx.x == 0 && num_missing != 0) atomicAdd(&numbers->missing, uint32_t(num_missing));
}

// What a photon makes, till it is known where it goes.
struct MadePhotons {
  Photon record;
  Ray next;
  bool has_record, has_next;
};

struct MadePhotonsSink {
  MadePhotons &made;
  __device__ void store(const Photon &record) const
  {
    made.record = record;
    made.has_record = true;
  }
  __device__ void next(const Ray &ray) const
  {
    made.next = ray;
    made.has_next = true;
  }
};

__device__ __forceinline__ void store_record(Photon *to, const Photon &p)
{
  float4 *q = reinterpret_cast<float4 *>(to);
  q[0] = make_float4(p.position.x, p.position.y, p.position.z, __uint_as_float(p.flux));
  q[1] = make_float4(__uint_as_float(p.direction), __uint_as_float(p.normal), __uint_as_float(p.id),
                     __uint_as_float(p.bounce));
}

template <bool MayAbsorb>
__global__ void __launch_bounds__(block_size)
    scatter_kernel(const __grid_constant__ PhotonFlight flight, const __grid_constant__ PhotonQueue from,
                   const Hit *hits, uint32_t n, const __grid_constant__ PhotonQueue to, Photon *records,
                   FlightNumbers *numbers)
{
  __shared__ uint32_t next_places[num_warps + 1], record_places[num_warps + 1];
  const uint64_t i = thread_item();
  MadePhotons made;
  made.record.bounce = 0;
  made.has_record = made.has_next = false;
  PhotonState photon;
  uint32_t triangle = invalid_id, num_hits_and_slot = 0;
  if (i < n) {
    const Hit hit = hits[i];
    triangle = hit.triangle;
    if (triangle != invalid_id) {
      const FlyingPhoton flying = from.photons[i];
      photon = {flying.flux,
                flying.id,
                {flying.seed, flying.reversed_index},
                MayAbsorb ? from.media[i] : medium_air};
      num_hits_and_slot = flying.num_hits_and_slot + 1;
      const uint32_t slot_bits = num_hits_and_slot >> slot_shift << slot_shift;
      BasicPhotonVertex<MayAbsorb>{flight.scene, flight.max_depth, num_hits_and_slot - slot_bits}.scatter(
          from.rays[i], hit, photon, MadePhotonsSink{made});
      made.record.bounce |= slot_bits;
    }
  }
  const uint32_t record_place = take_place(made.has_record, &numbers->stored, record_places);
  Box reached = empty_box();
  if (made.has_record) {
    store_record(records + record_place, made.record);
    if (is_finite(made.record.position)) reached = {made.record.position, made.record.position};
  }
  extend_bounds(&numbers->bounds, reached);
  const uint32_t next_place = take_place(made.has_next, &numbers->next, next_places);
  if (made.has_next) {
    to.photons[next_place] = {photon.flux, photon.id, photon.key.seed, photon.key.reversed_index,
                              num_hits_and_slot};
    store_ray(to.rays + next_place, made.next);
    if (MayAbsorb) to.media[next_place] = photon.medium;
    to.left_out[next_place] = flight.leaves_out ? leave_out(flight.scene, made.next, triangle) : invalid_id;
  }
}

}  // namespace

void launch_emit_photons(const PhotonFlight &flight, const PhotonQueue &queue, uint32_t first, uint32_t place,
                         uint32_t n, FlightNumbers *numbers, cudaStream_t stream)
{
  launch("kernel that emits photons", emit_kernel, n, stream, flight, queue, first, place, n, numbers);
}

void launch_scatter_photons(const PhotonFlight &flight, const PhotonQueue &from, const Hit *hits, uint32_t n,
                            const PhotonQueue &to, Photon *records, FlightNumbers *numbers,
                            cudaStream_t stream)
{
  launch("kernel that scatters photons", from.media != nullptr ? scatter_kernel<true> : scatter_kernel<false>,
         n, stream, flight, from, hits, n, to, records, numbers);
}

}  // namespace gpurt::cuda
