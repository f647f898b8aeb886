// One sample of stage 'blend'. For .cu files alone.
#pragma once

#include "core/reyes/blend.h"
#include "core/reyes/map.h"
#include "core/scene/surface.h"
#include "cuda/launch.h"
#include "cuda/reyes/blend.h"

namespace gpurt::cuda {

// The eye ray of a path of the group, and where its sample lies.
struct EyeSample {
  PathSample at;
  SampleKey key;
  Ray ray;
  float weight;
  uint32_t slot;
};

__device__ inline EyeSample eye_sample(const EyeHits &eye, uint32_t k)
{
  EyeSample e;
  e.at = path_sample(eye.unit, k);
  e.slot = uint32_t(slot_of(eye, k, e.at.local, e.at.sample - eye.unit.first_sample));
  e.key = sample_key(eye.settings.seed, eye.settings.frame_index, e.at.x, e.at.y, e.at.sample);
  const Vec2f u = sample_2d(e.key, dim_pixel);
  const FilteredPlace place = eye.places.filter == ReyesFilter::Box
                                  ? FilteredPlace{u, 1.0f}
                                  : place_sample(eye.places.filter, eye.places.table, u);
  float depth_per_t;
  e.ray = camera_ray(eye.settings.camera, float(e.at.x) + place.offset.x, float(e.at.y) + place.offset.y,
                     depth_per_t);
  e.weight = place.weight;
  return e;
}

// What does not blend there, or nothing.
__device__ inline Hit opaque_hit(const EyeHits &eye, const EyeSample &e)
{
  const unsigned long long key = eye.keys[e.slot];
  const uint32_t root = key != 0 ? ~uint32_t(key) : invalid_id;
  return hit_of_sample(eye.scene, eye.settings.camera, e.ray, root, float_from_bits(uint32_t(key >> 32)),
                       place_from_key(root != invalid_id ? eye.spots[e.slot] : 0));
}

__device__ inline Hit fragment_hit(const EyeHits &eye, const EyeSample &e, const KeptFragment &f)
{
  return hit_of_sample(eye.scene, eye.settings.camera, e.ray, f.root, f.z, {f.u, f.v});
}

__device__ inline bool is_in_view(const FragmentView &view, uint32_t slot)
{
  return slot - view.begin < view.end - view.begin;
}

// The state of a sample before its fragments of the view.
__device__ inline SampleBlend begin_blend(const Blending &b, const EyeSample &e, uint32_t k)
{
  if (b.is_first == 0) return b.samples[k];
  return {vec3(0.0f), 1.0f, sample_2d(e.key, dim_standing).x, {infinity, 0.0f, 0.0f, invalid_id, invalid_id}};
}

// A sample's fragments of the view: n of them from `first` on.
struct FragmentRun {
  uint64_t first;
  uint32_t n;
};

__device__ inline FragmentRun run_of_sample(const FragmentView &view, uint32_t slot)
{
  if (view.slots.layers == 0) {
    const uint64_t first = view.first[slot - view.origin];
    return {first - view.base, uint32_t(view.first[slot - view.origin + 1] - first)};
  }
  FragmentRun run{uint64_t(slot - view.begin) * view.slots.layers, 0};
  while (run.n != view.slots.layers && view.slots.keys[run.first + run.n] != 0) ++run.n;
  return run;
}

__device__ inline KeptFragment fragment_at(const FragmentView &view, uint64_t i)
{
  if (view.slots.layers == 0) return view.kept[i];
  const unsigned long long key = view.slots.keys[i];
  const Vec2f place = place_from_key(view.slots.places[i]);
  return {float_from_bits(uint32_t(key >> 32)), ~uint32_t(key), place.x, place.y};
}

__device__ inline FragmentMark mark_of(const KeptFragment &f)
{
  return {static_cast<unsigned long long>(float_bits(f.z)) << 32 | uint32_t(~f.root),
          static_cast<unsigned long long>(place_key({f.u, f.v}))};
}

__device__ inline void set_fragment_at(const FragmentView &view, uint64_t i, const KeptFragment &f)
{
  if (view.slots.layers == 0) {
    view.kept[i] = f;
    return;
  }
  const FragmentMark mark = mark_of(f);
  view.slots.keys[i] = mark.key;
  view.slots.places[i] = mark.place;
}

// Blends a sample's fragments of the view, and what lies behind them: show(hit, share, fragment) is called for all that is
// seen, from front to back; `fragment`: null for what does not blend.
template <class Show>
__device__ __forceinline__ void blend_sample(const Blending &b, const EyeSample &e, SampleBlend &state,
                                             const Show &show)
{
  const FragmentView &view = b.fragments;
  const FragmentSlots &slots = view.slots;
  const FragmentRun run = run_of_sample(view, e.slot);
  if (slots.layers == 0 && run.n > 1) sort_fragments(view.kept + run.first, run.n);
  KeptFragment last{0.0f, 0, 0.0f, 0.0f};
  bool is_open = false;
  for (uint32_t i = 0; state.through > least_through;) {
    Hit hit;
    float opacity = 1.0f;
    const KeptFragment *fragment = nullptr;
    if (i < run.n) {
      const KeptFragment f = fragment_at(view, run.first + i++);
      // One that comes twice.
      if (last.z > 0.0f && !precedes(last, f)) continue;
      last = f;
      hit = fragment_hit(b.eye, e, f);
      opacity = opacity_at(b.eye.scene.scene, hit.triangle, hit.u, hit.v);
      if (!(opacity > 0.0f)) continue;
      fragment = &last;
    } else {
      is_open = slots.had != nullptr && run.n == slots.layers;
      if (is_open) break;
      hit = opaque_hit(b.eye, e);
    }
    const float share = state.through * opacity;
    // The surface that stands for the sample is each with the probability of its share.
    if (state.to_standing >= 0.0f) {
      state.to_standing -= share;
      if (state.to_standing < 0.0f) state.standing = hit;
    }
    show(hit, share, fragment);
    state.through *= 1.0f - opacity;
  }
  if (slots.had == nullptr) return;
  // Of samples that have all, nothing is behind the mark.
  slots.had[e.slot - view.begin] = is_open ? mark_of(last) : FragmentMark{0, 0};
  if (is_open) atomicAdd(&b.eye.numbers->num_open, 1u);
}

// Of the lanes of a warp, into a number of all.
__device__ inline void add_shaded(ReyesNumbers *numbers, uint32_t num_shaded)
{
  for (int offset = 16; offset != 0; offset /= 2)
    num_shaded += __shfl_down_sync(0xffffffffu, num_shaded, offset);
  if (threadIdx.x % 32 == 0 && num_shaded != 0)
    atomicAdd(&numbers->num_shaded, static_cast<unsigned long long>(num_shaded));
}

}  // namespace gpurt::cuda
