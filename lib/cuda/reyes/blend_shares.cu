// Stage 'blend' where rays are needed: what is seen of each sample becomes paths whose hits are known.
#include "cuda/path/place.h"
#include "cuda/reyes/blend_sample.h"

namespace gpurt::cuda {
namespace {

// A thread a sample: of its fragments those that are shown stay.
__global__ void __launch_bounds__(block_size) find_shares(const __grid_constant__ Blending b)
{
  const uint64_t k = thread_item();
  if (k >= b.num_samples) return;
  const EyeSample e = eye_sample(b.eye, uint32_t(k));
  uint32_t num_shown = 0;
  float behind = 0.0f;
  if (is_in_view(b.fragments, e.slot)) {
    SampleBlend state = begin_blend(b, e, uint32_t(k));
    const uint64_t first = run_of_sample(b.fragments, e.slot).first;
    blend_sample(b, e, state, [&](const Hit &, float share, const KeptFragment *fragment) {
      if (fragment != nullptr) {
        set_fragment_at(b.fragments, first + num_shown, *fragment);
        b.shares[first + num_shown] = share;
      } else {
        behind = share;
      }
      ++num_shown;
    });
    b.samples[k] = state;
  }
  b.behind[k] = behind;
  b.num_shown[k] = num_shown;
}

// The sample that shows item g.
__device__ uint32_t sample_of_item(const Blending &b, uint32_t g)
{
  uint32_t lo = 0, hi = b.num_samples;
  while (hi - lo > 1) {
    const uint32_t middle = lo + (hi - lo) / 2;
    if (b.first_shown[middle] <= g) lo = middle;
    else hi = middle;
  }
  return lo;
}

__global__ void __launch_bounds__(block_size)
    make_shown_paths(const __grid_constant__ Blending b, const __grid_constant__ PathWave wave,
                     uint32_t first, uint32_t n)
{
  const uint32_t i = uint32_t(thread_item());
  uint32_t num_shaded = 0;
  if (i < n) {
    const uint32_t k = sample_of_item(b, first + i), item = first + i - b.first_shown[k];
    const EyeSample e = eye_sample(b.eye, k);
    Hit hit;
    float share = b.behind[k];
    if (share > 0.0f && item + 1 == b.first_shown[k + 1] - b.first_shown[k]) {
      hit = opaque_hit(b.eye, e);
    } else {
      const uint64_t at = run_of_sample(b.fragments, e.slot).first + item;
      hit = fragment_hit(b.eye, e, fragment_at(b.fragments, at));
      share = b.shares[at];
    }
    wave.rays.rays[i] = e.ray;
    wave.rays.paths[i] = i;
    wave.hits[i] = hit;
    wave.paths[i] = {vec3(e.weight * share), 0.0f, vec3(0.0f), vec3(0.0f), vec3(0.0f), e.key, 0};
    num_shaded = hit.triangle != invalid_id ? 1 : 0;
  }
  add_shaded(b.eye.numbers, num_shaded);
}

// The first item of each sample in the wave adds the light of all, in their order.
__global__ void __launch_bounds__(block_size)
    add_shown(const __grid_constant__ Blending b, const PathState *paths, uint32_t first, uint32_t n)
{
  const uint32_t i = uint32_t(thread_item());
  if (i >= n) return;
  const uint32_t k = sample_of_item(b, first + i);
  if (i != 0 && b.first_shown[k] != first + i) return;
  const uint32_t end = min(b.first_shown[k + 1] - first, n);
  Vec3f radiance = b.samples[k].radiance;
  for (uint32_t j = i; j < end; ++j) radiance += paths[j].radiance;
  b.samples[k].radiance = radiance;
}

}  // namespace

void launch_find_shares(const Blending &blending, void *scan_memory, uint64_t scan_bytes, cudaStream_t stream)
{
  const uint32_t n = blending.num_samples;
  launch("REYES stage 'blend'", find_shares, n, stream, blending);
  launch_place_by_library_scan(blending.num_shown, n, scan_memory, scan_bytes, blending.first_shown,
                               blending.first_shown + n, stream);
  check(cudaMemcpyAsync(&blending.eye.numbers->num_items, blending.first_shown + n, sizeof(uint32_t),
                        cudaMemcpyDeviceToDevice, stream),
        "cudaMemcpyAsync");
}

void launch_make_shown_paths(const Blending &blending, const PathWave &wave, uint32_t first, uint32_t n,
                             cudaStream_t stream)
{
  launch("REYES stage 'map' of what is blended", make_shown_paths, n, stream, blending, wave, first, n);
}

void launch_add_shown(const Blending &blending, const PathWave &wave, uint32_t first, uint32_t n,
                      cudaStream_t stream)
{
  launch("REYES' light of what is blended", add_shown, n, stream, blending,
         static_cast<const PathState *>(wave.paths), first, n);
}

}  // namespace gpurt::cuda
