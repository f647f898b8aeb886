// A bucket with surfaces that blend, on one thread: an A-buffer in two passes.
//
// Fragments are counted, and then kept in exactly as much memory. A bucket that has more than there is room for is done in
// quarters; one of smallest_blend_edge pixels is peeled: passes that keep the nearest layers behind those that a sample has
// had. Every way shades the same fragments in the same order, so that memory changes no bit.
//
// With ReyesSettings::fragment_slots it is the fixed A-buffer: one pass, in which a sample keeps its nearest fragments, as many
// as it has slots, and the others are lost.
#pragma once

#include "core/reyes/filter.h"
#include "core/reyes/map.h"
#include "cpu/path/serial_executor.h"
#include "cpu/reyes/fragments.h"
#include "cpu/reyes/places.h"
#include "cpu/reyes/reyes_kernel.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN
namespace {

// Path tracing's stages for hits that are known.
class HitExecutor : public SerialExecutor {
 public:
  HitExecutor(const CpuAccel &accel, const ReyesSettings &reyes, bool has_found_light, double (*seconds)(),
              PathKernelCounters &counters)
      : SerialExecutor(accel, seconds, counters), reyes_(reyes), has_found_light_(has_found_light)
  {
    is_first_trace_ = false;
  }

  void shade(const SceneView &scene, const PathSettings &settings, const PathWave &wave, uint32_t n)
  {
    uint32_t num_rays = n;
    for (uint32_t depth = 1; num_rays != 0; ++depth) {
      if (depth > 1) trace_closest(wave.rays.rays, wave.hits, num_rays);
      for_each(PathStage::Shade, num_rays, ShadePathVertex{scene, settings, wave, depth});
      const uint32_t num_shadows = compact_shadows(wave.shadows, num_rays, wave.shadow_queue);
      if (!reyes_.no_shadows) trace_occluded(wave.shadow_queue.rays, wave.occluded, num_shadows);
      else
        for (uint32_t i = 0; i < num_shadows; ++i) wave.occluded[i] = 0;
      for_each(PathStage::Shadow, num_shadows, AddDirectLight{wave});
      num_rays = has_found_light_ ? compact_rays(wave.next_rays, num_rays, wave.rays) : 0;
    }
  }

 private:
  const ReyesSettings &reyes_;
  const bool has_found_light_;
};

// `Find(bucket, sink)` puts all that blends within a bucket into the sink, behind nothing that is opaque; without a sink it
// finds what is opaque.
template <class Find>
class BlendedBucket {
 public:
  BlendedBucket(const CpuAccel &accel, const ReyesScene &scene, const PathSettings &settings,
                const ReyesSettings &reyes, const ReyesMemory &memory, const BlendMemory &blend,
                const PathWave &wave, uint32_t wave_capacity, const FilmView &film, uint32_t film_x,
                uint32_t film_y, double (*seconds)(), ReyesKernelCounters &counters, const Find &find)
      : accel_(accel),
        scene_(scene),
        settings_(settings),
        reyes_(reyes),
        memory_(memory),
        blend_(blend),
        wave_(wave),
        wave_capacity_(wave_capacity),
        film_(film),
        film_x_(film_x),
        film_y_(film_y),
        seconds_(seconds),
        counters_(counters),
        find_(find)
  {}

  void run(const ReyesBucket &bucket)
  {
    const uint32_t width = bucket.x1 - bucket.x0, height = bucket.y1 - bucket.y0;
    const uint32_t num_samples = uint32_t(uint64_t(width) * height * bucket.num_samples);
    const bool is_smallest = width <= smallest_blend_edge && height <= smallest_blend_edge;
    // How many slots there are is known without a look.
    const uint64_t num_slots = uint64_t(num_samples) * reyes_.fragment_slots;
    if (num_slots > blend_.capacity && !is_smallest) {
      run_quarters(bucket);
      return;
    }
    find_(bucket, nullptr);
    for (uint32_t k = 0; k < num_samples; ++k) blend_.count[k] = 0;
    FragmentSink sink{FragmentSink::Mode::Count, 0,           blend_.count, blend_.first,
                      blend_.fragments,          blend_.last, nullptr};
    if (num_slots != 0) {
      begin(bucket, num_samples);
      fill_slots(bucket, num_samples, sink);
      end(bucket, num_samples);
      return;
    }
    find_(bucket, &sink);
    const uint64_t total = num_kept(num_samples);
    counters_.num_fragments += total;
    if (total > blend_.capacity && !is_smallest) {
      run_quarters(bucket);
      return;
    }
    begin(bucket, num_samples);
    counters_.largest_fragments = max(counters_.largest_fragments, min(total, uint64_t(blend_.capacity)));
    if (total <= blend_.capacity) {
      uint32_t sum = 0;
      for (uint32_t k = 0; k < num_samples; ++k) {
        blend_.first[k] = sum;
        sum += blend_.count[k];
        blend_.count[k] = 0;
      }
      sink.mode = FragmentSink::Mode::Keep;
      find_(bucket, &sink);
      for (uint32_t k = 0; k < num_samples; ++k)
        sort_fragments(blend_.fragments + blend_.first[k], blend_.count[k]);
      blend(bucket, num_samples, ~0u);
    } else {
      peel(bucket, num_samples, sink);
    }
    end(bucket, num_samples);
  }

 private:
  void run_quarters(const ReyesBucket &bucket)
  {
    const uint32_t width = bucket.x1 - bucket.x0, height = bucket.y1 - bucket.y0;
    const uint32_t x = width > smallest_blend_edge ? bucket.x0 + width / 2 : bucket.x1;
    const uint32_t y = height > smallest_blend_edge ? bucket.y0 + height / 2 : bucket.y1;
    for (uint32_t row = 0; row < 2; ++row) {
      for (uint32_t column = 0; column < 2; ++column) {
        ReyesBucket part = bucket;
        (column == 0 ? part.x1 : part.x0) = x;
        (row == 0 ? part.y1 : part.y0) = y;
        if (part.x0 < part.x1 && part.y0 < part.y1) run(part);
      }
    }
  }

  uint64_t num_kept(uint32_t num_samples) const
  {
    uint64_t total = 0;
    for (uint32_t k = 0; k < num_samples; ++k) total += blend_.count[k];
    return total;
  }

  // The fixed A-buffer: what is behind a sample's last slot is lost.
  void fill_slots(const ReyesBucket &bucket, uint32_t num_samples, FragmentSink sink)
  {
    uint64_t num_lost = 0;
    sink.num_lost = &num_lost;
    put_layers(bucket, num_samples, reyes_.fragment_slots, sink);
    const uint64_t kept = num_kept(num_samples);
    counters_.num_fragments += kept + num_lost;
    counters_.num_lost_fragments += num_lost;
    counters_.largest_fragments = max(counters_.largest_fragments, kept);
    blend(bucket, num_samples, ~0u);
  }

  // Of each sample, the nearest fragments behind those that it has had.
  void put_layers(const ReyesBucket &bucket, uint32_t num_samples, uint32_t layers, FragmentSink &sink)
  {
    sink.mode = FragmentSink::Mode::Peel;
    sink.layers = layers;
    for (uint32_t k = 0; k < num_samples; ++k) {
      blend_.first[k] = k * layers;
      blend_.count[k] = 0;
    }
    find_(bucket, &sink);
  }

  void begin(const ReyesBucket &bucket, uint32_t num_samples)
  {
    const PathUnit unit = unit_of(bucket);
    for (uint32_t k = 0; k < num_samples; ++k) {
      const PathSample s = path_sample(unit, k);
      const SampleKey key = sample_key(settings_.seed, settings_.frame_index, s.x, s.y, s.sample);
      const uint32_t slot = memory_.slot[k];
      blend_.last[slot].z = 0.0f;
      blend_.through[slot] = 1.0f;
      blend_.to_standing[slot] = sample_2d(key, dim_standing).x;
      blend_.radiance[slot] = vec3(0.0f);
      blend_.standing[slot].triangle = invalid_id;
    }
    num_waiting_ = 0;
  }

  void peel(const ReyesBucket &bucket, uint32_t num_samples, FragmentSink sink)
  {
    const uint32_t layers = uint32_t(blend_.capacity / num_samples);
    do {
      put_layers(bucket, num_samples, layers, sink);
    } while (blend(bucket, num_samples, layers));
  }

  // Shades what samples have, and what lies behind it unless they have `limit` fragments and more may come. Returns whether
  // more may.
  bool blend(const ReyesBucket &bucket, uint32_t num_samples, uint32_t limit)
  {
    bool may_go_on = false;
    for (uint32_t k = 0; k < num_samples; ++k) {
      const uint32_t slot = memory_.slot[k], n = blend_.count[slot];
      float &through = blend_.through[slot];
      if (!(through > least_through)) continue;
      Fragment &last = blend_.last[slot];
      for (uint32_t i = 0; i < n && through > least_through; ++i) {
        const Fragment &f = blend_.fragments[blend_.first[slot] + i];
        // One that comes twice.
        if (last.z > 0.0f && !precedes(last, f)) continue;
        last = f;
        show(bucket, k, slot, f.root, f.z, {f.u, f.v}, through * f.opacity);
        through *= 1.0f - f.opacity;
      }
      if (!(through > least_through)) continue;
      if (n == limit) {
        may_go_on = true;
        continue;
      }
      show(bucket, k, slot, memory_.root[slot], memory_.z[slot], {memory_.u[slot], memory_.v[slot]}, through);
      through = 0.0f;
    }
    shade_waiting(bucket);
    return may_go_on;
  }

  // Adds a surface, or the background, that makes up `share` of a sample.
  void show(const ReyesBucket &bucket, uint32_t k, uint32_t slot, uint32_t root, float z, Vec2f place,
            float share)
  {
    const PathSample s = path_sample(unit_of(bucket), k);
    const bool is_box = reyes_.filter == ReyesFilter::Box;
    const uint32_t i = num_waiting_++;
    const Ray ray = ray_of_sample(settings_.camera, memory_, s, k);
    wave_.rays.rays[i] = ray;
    wave_.rays.paths[i] = i;
    wave_.hits[i] = hit_of_sample(scene_, settings_.camera, ray, root, z, place);
    wave_.paths[i] = {vec3(is_box ? share : memory_.weight[k] * share),
                      0.0f,
                      vec3(0.0f),
                      vec3(0.0f),
                      vec3(0.0f),
                      sample_key(settings_.seed, settings_.frame_index, s.x, s.y, s.sample),
                      0,
                      medium_air};
    blend_.owner[i] = slot;
    counters_.num_shaded += root != invalid_id;
    // The surface that stands for the sample is each with the probability of its share.
    float &to_standing = blend_.to_standing[slot];
    if (to_standing >= 0.0f) {
      to_standing -= share;
      if (to_standing < 0.0f) blend_.standing[slot] = wave_.hits[i];
    }
    if (num_waiting_ == wave_capacity_) shade_waiting(bucket);
  }

  void shade_waiting(const ReyesBucket &bucket)
  {
    HitExecutor executor(accel_, reyes_, bucket.has_found_light, seconds_, counters_.path);
    executor.shade(scene_.scene, settings_, wave_, num_waiting_);
    for (uint32_t i = 0; i < num_waiting_; ++i) blend_.radiance[blend_.owner[i]] += wave_.paths[i].radiance;
    num_waiting_ = 0;
  }

  void end(const ReyesBucket &bucket, uint32_t num_samples)
  {
    const EyeFeatures features{scene_.scene, settings_, film_};
    const PathUnit unit = unit_of(bucket);
    for (uint32_t k = 0; k < num_samples; ++k) {
      const PathSample s = path_sample(unit, k);
      const uint32_t slot = memory_.slot[k], pixel = (s.y - film_y_) * film_.width + (s.x - film_x_);
      const Vec3f radiance = blend_.radiance[slot];
      const Hit &standing = blend_.standing[slot];
      if (film_.features != nullptr || film_.first_hits != nullptr) {
        const Ray ray = ray_of_sample(settings_.camera, memory_, s, k);
        features(s.sample, pixel, ray, standing, [](int64_t &sum, int64_t term) { sum += term; });
      }
      add_sample(film_.pixels[pixel], s.sample, radiance, standing.triangle != invalid_id);
      counters_.path.largest_sample = max(counters_.path.largest_sample, max_component(radiance));
    }
  }

  static PathUnit unit_of(const ReyesBucket &b) { return {b.x0, b.y0, b.x1, b.y1, b.first_sample, 0}; }

  const CpuAccel &accel_;
  const ReyesScene &scene_;
  const PathSettings &settings_;
  const ReyesSettings &reyes_;
  const ReyesMemory &memory_;
  const BlendMemory &blend_;
  const PathWave &wave_;
  const uint32_t wave_capacity_;
  const FilmView &film_;
  const uint32_t film_x_, film_y_;
  double (*seconds_)();
  ReyesKernelCounters &counters_;
  const Find &find_;
  uint32_t num_waiting_ = 0;
};

}  // namespace
GPURT_FUNCTIONS_END
}  // namespace gpurt
