// Stage 'shade' of micropolygons after visibility: the points that samples see, their light, and the film.
#include "core/reyes/lit_point.h"
#include "cuda/launch.h"
#include "cuda/reyes/blend_sample.h"
#include "cuda/reyes/shade_points.h"
#include "cuda/reyes/sums.h"

namespace gpurt::cuda {
namespace {

// Where the sample of a path of the group lies, and which of its pixel's it is.
__device__ __forceinline__ uint32_t slot_of_path(const PointView &v, uint32_t k, uint64_t &sample)
{
  const PathSample s = path_sample(v.eye.unit, k);
  sample = s.sample;
  return uint32_t(slot_of(v.eye, k, s.local, s.sample - v.eye.unit.first_sample));
}

__device__ __forceinline__ PointPlace place_of_slot(const PointView &v, uint32_t slot)
{
  return {~uint32_t(v.eye.keys[slot]), place_from_key(v.eye.spots[slot])};
}

__device__ __forceinline__ PointPlace place_of_path(const PointView &v, uint32_t k, uint32_t &group)
{
  uint64_t sample;
  const uint32_t slot = slot_of_path(v, k, sample);
  group = group_of_sample(sample, v.eye.unit.first_sample, v.is_sampled != 0);
  return place_of_slot(v, slot);
}

__global__ void __launch_bounds__(block_size)
    dice_triangles(const __grid_constant__ PointView v, unsigned long long *spots)
{
  const uint32_t slot = uint32_t(thread_item());
  if (slot >= v.num_samples || v.eye.keys[slot] == 0) return;
  const PointPlace place = place_of_slot(v, slot);
  spots[slot] = place_key(
      diced_place(v.eye.scene, raster_projection(v.eye.settings.camera), place.root, place.at, v.edge2));
}

__global__ void __launch_bounds__(block_size) find_points(const __grid_constant__ PointView v)
{
  const uint32_t k = uint32_t(thread_item()), lane = threadIdx.x % 32;
  bool stands = false;
  if (k < v.num_samples) {
    uint64_t sample;
    const uint32_t slot = slot_of_path(v, k, sample);
    uint32_t found = invalid_id;
    if (v.eye.keys[slot] != 0) {
      const PointPlace place = place_of_slot(v, slot);
      const uint32_t group = group_of_sample(sample, v.eye.unit.first_sample, v.is_sampled != 0);
      for (uint32_t at = uint32_t(hash_of_place(place)) + group * 0x9e3779b1u;; ++at) {
        uint32_t *entry = v.table + (at & v.table_mask);
        found = *const_cast<volatile uint32_t *>(entry);
        if (found == invalid_id) found = atomicCAS(entry, invalid_id, k);
        if (found == invalid_id) {
          found = k;
          stands = true;
          break;
        }
        uint32_t other_group;
        const PointPlace other = place_of_path(v, found, other_group);
        if (other_group == group && is_same_place(other, place)) break;
      }
    }
    v.point_of[k] = found;
  }
  __syncwarp();
  const uint32_t lanes = __ballot_sync(0xffffffffu, stands);
  if (lanes == 0) return;
  uint32_t base = 0;
  if (lane == 0) base = atomicAdd(v.num_points, uint32_t(__popc(lanes)));
  base = __shfl_sync(0xffffffffu, base, 0);
  if (stands) v.points[base + uint32_t(__popc(lanes & ((1u << lane) - 1)))] = k;
}

__global__ void __launch_bounds__(block_size)
    make_point_paths(const __grid_constant__ PointView v, const __grid_constant__ PathWave wave,
                     uint32_t first, uint32_t n)
{
  const uint32_t i = uint32_t(thread_item());
  if (i >= n) return;
  uint32_t group;
  const PointPlace place = place_of_path(v, v.points[first + i], group);
  wave.hits[i] = hit_of_place(v.eye.scene, v.eye.settings.camera, place, wave.rays.rays[i]);
  wave.rays.paths[i] = i;
  const SampleKey key = key_of_place(v.eye.settings, place, v.eye.unit.first_sample, group);
  wave.paths[i] = {vec3(1.0f), 0.0f, vec3(0.0f), vec3(0.0f), vec3(0.0f), key, 0, medium_air};
}

__global__ void __launch_bounds__(block_size)
    make_point_shadows(const __grid_constant__ PointView v, const __grid_constant__ PathWave wave,
                       uint32_t light, uint32_t first, uint32_t n)
{
  const uint32_t i = uint32_t(thread_item());
  if (i >= n) return;
  uint32_t group;
  const LitPoint p =
      lit_point(v.eye.scene, v.eye.settings.camera, place_of_path(v, v.points[first + i], group));
  Ray ray;
  Vec3f contribution;
  if (make_shadow_ray(v.eye.scene.scene.lights[light], p, ray, contribution)) {
    wave.shadows.rays[i] = ray;
    wave.shadows.contributions[i] = contribution;
  } else {
    wave.shadows.rays[i].tmax = -1.0f;
  }
  wave.shadows.paths[i] = i;
}

__global__ void __launch_bounds__(block_size) clear_paths(PathState *paths, uint32_t n)
{
  const uint32_t i = uint32_t(thread_item());
  if (i < n) paths[i].radiance = vec3(0.0f);
}

__global__ void __launch_bounds__(block_size)
    keep_point_light(const __grid_constant__ PointView v, const PathState *paths, uint32_t first, uint32_t n)
{
  const uint32_t i = uint32_t(thread_item());
  if (i < n) v.light[v.points[first + i]] = paths[i].radiance;
}

// A thread a pixel. Features of a sample are those of its point, but for the depth, which is its own.
__global__ void __launch_bounds__(block_size)
    resolve_points(const __grid_constant__ PointView v, const __grid_constant__ FilmView film,
                   uint32_t num_pixels, uint32_t *largest_bits)
{
  const uint32_t i = uint32_t(thread_item());
  float largest = 0.0f;
  if (i < num_pixels) {
    const bool has_features = film.features != nullptr || film.first_hits != nullptr;
    PixelSums sums{};
    uint32_t local = 0;
    for (uint64_t turn = 0; turn < v.eye.places.num_samples; ++turn) {
      const uint32_t k = uint32_t(turn * num_pixels + i), point = v.point_of[k];
      const EyeSample e = eye_sample(v.eye, k);
      local = e.at.local;
      const bool covered = point != invalid_id;
      Vec3f light = vec3(0.0f);
      if (covered) light = v.light[point];
      else if (v.eye.scene.scene.environment.is_present)
        light = environment_radiance(v.eye.scene.scene, e.ray.direction);
      light *= e.weight;
      if (has_features) {
        EyeFeatures{v.eye.scene.scene, v.eye.settings, film}(e.at.sample, e.at.local, e.ray,
                                                             opaque_hit(v.eye, e),
                                                             [](int64_t &sum, int64_t term) { sum += term; });
      }
      add_sample(sums, e.at.sample, light, covered);
      const float component = max_component(light);
      largest = component > largest ? component : largest;
    }
    film.pixels[local] = sums;
  }
  keep_largest(largest, largest_bits);
}

}  // namespace

void launch_dice_triangles(const PointView &view, unsigned long long *spots, cudaStream_t stream)
{
  launch("REYES stage 'dice' of triangles", dice_triangles, view.num_samples, stream, view, spots);
}

void launch_find_points(const PointView &view, cudaStream_t stream)
{
  launch("REYES' points that samples see", find_points, view.num_samples, stream, view);
}

void launch_point_paths(const PointView &view, const PathWave &wave, uint32_t first, uint32_t n,
                        cudaStream_t stream)
{
  launch("REYES stage 'map' of points", make_point_paths, n, stream, view, wave, first, n);
}

void launch_point_shadows(const PointView &view, const PathWave &wave, uint32_t light, uint32_t first,
                          uint32_t n, cudaStream_t stream)
{
  launch("REYES stage 'shade' of points, by a light", make_point_shadows, n, stream, view, wave, light, first,
         n);
}

void launch_clear_paths(const PathWave &wave, uint32_t n, cudaStream_t stream)
{
  launch("REYES' points without light", clear_paths, n, stream, wave.paths, n);
}

void launch_keep_point_light(const PointView &view, const PathWave &wave, uint32_t first, uint32_t n,
                             cudaStream_t stream)
{
  launch("REYES' light of points", keep_point_light, n, stream, view,
         static_cast<const PathState *>(wave.paths), first, n);
}

void launch_resolve_points(const PointView &view, const FilmView &film, uint32_t num_pixels,
                           uint32_t *largest_bits, cudaStream_t stream)
{
  launch("REYES stage 'resolve' of points", resolve_points, num_pixels, stream, view, film, num_pixels,
         largest_bits);
}

}  // namespace gpurt::cuda
