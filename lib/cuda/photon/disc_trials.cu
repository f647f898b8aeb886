// How much of visible points' discs lies on surfaces: see core/photon/disc_area.h. Points that miss again and again have
// their next trials side by side, so that few of them cost few rounds; the first trial that ends counts.
#include "cuda/launch.h"
#include "cuda/path/pool_places.h"
#include "cuda/photon/eye_paths.h"
#include "cuda/warp_reduce.h"

namespace gpurt::cuda {
namespace {

__global__ void __launch_bounds__(block_size) begin_kernel(const __grid_constant__ EyeWave wave, uint32_t n)
{
  __shared__ uint32_t places[num_warps + 1];
  const uint64_t i = thread_item();
  const bool wants = i < n && wants_disc_trials(wave.passes[slot_of(wave, uint32_t(i))], wave.points[i]);
  const uint32_t place = take_place(wants, &wave.numbers->next, places);
  if (!wants) return;
  const PhotonPass pass = wave.passes[slot_of(wave, uint32_t(i))];
  store_ray(wave.queues[0].rays + place, disc_probe(pass, wave.states[i].key, wave.points[i], 0));
  wave.queues[0].paths[place] = uint32_t(i);
}

__global__ void __launch_bounds__(block_size)
    end_kernel(const __grid_constant__ EyeWave wave, int from, DiscTrials trials, uint32_t num_points)
{
  __shared__ uint32_t places[num_warps + 1];
  const uint64_t i = thread_item();
  bool goes_on = false;
  uint32_t path = 0, num_tried = 0;
  if (i < num_points) {
    path = wave.queues[from].paths[i];
    const PhotonPass pass = wave.passes[slot_of(wave, path)];
    const VisiblePoint &point = wave.points[path];
    const SampleKey key = wave.states[path].key;
    int32_t missed = point.missed;
    goes_on = true;
    while (goes_on && num_tried < trials.per_point) {
      goes_on = !lies_on_surface(wave.scene, pass, point, wave.hits[i * trials.per_point + num_tried]);
      if (goes_on) missed += missed_blur(key, pass.kernel, trials.first + num_tried);
      ++num_tried;
    }
    wave.points[path].inverse_area = float(trials.first + num_tried);
    wave.points[path].missed = missed;
    goes_on = goes_on && trials.first + num_tried < max_disc_trials;
  }
  const unsigned num_tried_of_warp = warp_sum(num_tried);
  if (threadIdx.x % warp_size == 0 && num_tried_of_warp != 0)
    atomicAdd(&wave.numbers->num_probes, static_cast<unsigned long long>(num_tried_of_warp));
  const uint32_t place = take_place(goes_on, &wave.numbers->next, places);
  if (goes_on) wave.queues[1 - from].paths[place] = path;
}

__global__ void __launch_bounds__(block_size)
    aim_kernel(const __grid_constant__ EyeWave wave, int from, DiscTrials trials, uint32_t num_points)
{
  const uint64_t i = thread_item();
  if (i >= uint64_t(num_points) * trials.per_point) return;
  const uint32_t path = wave.queues[from].paths[i / trials.per_point];
  const PhotonPass pass = wave.passes[slot_of(wave, path)];
  store_ray(wave.queues[from].rays + i, disc_probe(pass, wave.states[path].key, wave.points[path],
                                                   trials.first + uint32_t(i % trials.per_point)));
}

}  // namespace

void launch_begin_disc_trials(const EyeWave &wave, uint32_t n, cudaStream_t stream)
{
  launch("kernel that begins trials of discs", begin_kernel, n, stream, wave, n);
}

void launch_end_disc_trials(const EyeWave &wave, int from, DiscTrials trials, uint32_t num_points,
                            cudaStream_t stream)
{
  launch("kernel that ends trials of discs", end_kernel, num_points, stream, wave, from, trials, num_points);
}

void launch_aim_disc_trials(const EyeWave &wave, int from, DiscTrials trials, uint32_t num_points,
                            cudaStream_t stream)
{
  launch("kernel that aims trials of discs", aim_kernel, uint64_t(num_points) * trials.per_point, stream,
         wave, from, trials, num_points);
}

}  // namespace gpurt::cuda
