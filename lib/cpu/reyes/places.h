// The places of a bucket's samples, sorted by cells.
#pragma once

#include "core/path/path_wave.h"
#include "core/reyes/filter.h"
#include "core/reyes/sample.h"
#include "cpu/reyes/place_rows.h"
#include "cpu/reyes/reyes_kernel.h"
#include "cpu/reyes/wide_kernel.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN
namespace {

class Places {
 public:
  Places(const PathSettings &settings, const ReyesSettings &reyes, const ReyesBucket &bucket,
         const ReyesMemory &memory)
      : settings_(settings),
        reyes_(reyes),
        memory_(memory),
        num_samples_(uint32_t(uint64_t(bucket.x1 - bucket.x0) * (bucket.y1 - bucket.y0) * bucket.num_samples))
  {
    const int32_t reach = filter_reach(reyes.filter);
    SampleBlock &b = block_;
    b.cell_bits = bucket.num_samples >= 3 ? unit_bits - 1 : unit_bits;
    b.cells_x = int32_t(bucket.x1 - bucket.x0 + 2 * uint32_t(reach)) << (unit_bits - b.cell_bits);
    b.cells_y = int32_t(bucket.y1 - bucket.y0 + 2 * uint32_t(reach)) << (unit_bits - b.cell_bits);
    b.origin_x = (int32_t(bucket.x0) - reach) * (1 << unit_bits);
    b.origin_y = (int32_t(bucket.y0) - reach) * (1 << unit_bits);
    b.num_samples = num_samples_;
    b.x = memory.x;
    b.y = memory.y;
    b.z = memory.z;
    b.root = memory.root;
    b.u = memory.u;
    b.v = memory.v;
    b.first = memory.first;
    if (reyes.filter != ReyesFilter::Box) make_filter_table(reyes.filter, table_);
    // In the order of the paths that shade them.
    const PathUnit unit{bucket.x0, bucket.y0, bucket.x1, bucket.y1, bucket.first_sample, 0};
    const uint32_t width = bucket.x1 - bucket.x0, height = bucket.y1 - bucket.y0, num = num_samples_;
    for (uint32_t k = 0; k < num; ++k) memory.z[k] = 0.0f;
    for (uint32_t k = 0; k < num; ++k) memory.root[k] = invalid_id;
    const bool keeps_places = reyes.shading == ReyesShading::Samples || bucket.lights_by_rays;
    if (bucket.num_roots == 0 && reyes.filter == ReyesFilter::Box && !keeps_places) {
      // Nothing looks for them: any slots do.
      for (uint32_t k = 0; k < num; ++k) memory.slot[k] = k;
      return;
    }
    const uint64_t last_sample = bucket.first_sample + bucket.num_samples - 1;
    if (reyes.filter == ReyesFilter::Box && width % 8 == 0 && height % 4 == 0 && width <= most_row_pixels &&
        bucket.num_samples <= most_placed_samples && bucket.first_sample >> 33 == last_sample >> 33) {
      const PlacedRows rows{
          memory, b,      settings.seed,       settings.frame_index,         bucket.x0,   bucket.y0,
          width,  height, bucket.first_sample, uint32_t(bucket.num_samples), keeps_places};
      if (bucket.wide != nullptr) bucket.wide->place_rows(rows);
      else gpurt::place_rows<UintLanes>(rows);
      return;
    }
    // Until a surface is taken, u and v hold raster units, and slots are cells. Eight paths in a row are then eight pixels in a row (path_sample).
    if (width % 8 == 0 && height % 4 == 0) {
      for (uint32_t p = 0; p < width * height; p += num_lanes)
        place_pixels(unit, bucket.num_samples, width * height, p);
    } else {
      for (uint32_t k = 0; k < num; ++k) place_path(unit, k);
    }
    sort();
  }

  const SampleBlock &block() const { return block_; }

 private:
  // All samples of the pixels of paths p .. p + 7.
  void place_pixels(const PathUnit &unit, uint64_t num, uint32_t num_pixels, uint32_t p)
  {
    const PathSample pixel = path_sample(unit, p);
    const float corner_x = float(int32_t(pixel.x) * (1 << unit_bits) - block_.origin_x),
                corner_y = float(int32_t(pixel.y) * (1 << unit_bits) - block_.origin_y);
    const FloatLanes left =
        corner_x + FloatLanes{0.0f, 1.0f, 2.0f, 3.0f, 4.0f, 5.0f, 6.0f, 7.0f} * units_per_pixel;
    // Even and odd samples have a sequence each, whose seed is found once (sample_key, sample_2d).
    UintLanes low[2], high[2];
    uint64_t sequence = ~uint64_t(0);
    for (uint64_t turn = 0; turn < num; ++turn) {
      const uint64_t sample = unit.first_sample + turn;
      if (sample >> 33 != sequence) {
        sequence = sample >> 33;
        for (uint32_t i = 0; i < num_lanes; ++i) {
          for (uint32_t parity = 0; parity < 2; ++parity) {
            const SampleKey key = sample_key(settings_.seed, settings_.frame_index, pixel.x + i, pixel.y,
                                             sequence << 33 | parity);
            const uint64_t seed = mix_bits(key.seed + 0x9e3779b97f4a7c15u * (uint64_t(dim_pixel) + 1));
            low[parity][i] = uint32_t(seed);
            high[parity][i] = uint32_t(seed >> 32);
          }
        }
      }
      UintLanes bits_x, bits_y;
      sample_2d_bits(low[sample & 1], high[sample & 1], reverse_bits(uint32_t(sample >> 1)), bits_x, bits_y);
      FloatLanes x = float_lanes((IntLanes)(bits_x >> 8)) * 0x1p-24f,
                 y = float_lanes((IntLanes)(bits_y >> 8)) * 0x1p-24f, weight = lanes(1.0f);
      if (reyes_.filter != ReyesFilter::Box) {
        for (uint32_t i = 0; i < num_lanes; ++i) {
          const FilteredPlace place = place_sample(reyes_.filter, table_, {x[i], y[i]});
          x[i] = place.offset.x;
          y[i] = place.offset.y;
          weight[i] = place.weight;
        }
      }
      const uint64_t k = turn * num_pixels + p;
      store_lanes(memory_.place_x + k, x);
      store_lanes(memory_.place_y + k, y);
      store_lanes(memory_.weight + k, weight);
      const FloatLanes u = floor(x * units_per_pixel) + left, v = floor(y * units_per_pixel) + corner_y;
      store_lanes(memory_.u + k, u);
      store_lanes(memory_.v + k, v);
      const IntLanes cell =
          (int_lanes(v) >> block_.cell_bits) * block_.cells_x + (int_lanes(u) >> block_.cell_bits);
      store_lanes(memory_.slot + k, (UintLanes)cell);
    }
  }

  void place_path(const PathUnit &unit, uint32_t k)
  {
    const PathSample s = path_sample(unit, k);
    const SampleKey key = sample_key(settings_.seed, settings_.frame_index, s.x, s.y, s.sample);
    const FilteredPlace place = place_sample(reyes_.filter, table_, sample_2d(key, dim_pixel));
    memory_.place_x[k] = place.offset.x;
    memory_.place_y[k] = place.offset.y;
    memory_.weight[k] = place.weight;
    const float u =
        floor(place.offset.x * units_per_pixel) + float(int32_t(s.x) * (1 << unit_bits) - block_.origin_x);
    const float v =
        floor(place.offset.y * units_per_pixel) + float(int32_t(s.y) * (1 << unit_bits) - block_.origin_y);
    memory_.u[k] = u;
    memory_.v[k] = v;
    memory_.slot[k] =
        (uint32_t(v) >> block_.cell_bits) * uint32_t(block_.cells_x) + (uint32_t(u) >> block_.cell_bits);
  }

  void sort()
  {
    const uint32_t num_cells = uint32_t(block_.cells_x) * uint32_t(block_.cells_y);
    for (uint32_t c = 0; c <= num_cells; ++c) memory_.first[c] = 0;
    for (uint32_t k = 0; k < num_samples_; ++k) memory_.first[memory_.slot[k]]++;
    uint32_t sum = 0;
    for (uint32_t c = 0; c <= num_cells; ++c) {
      const uint32_t count = memory_.first[c];
      memory_.first[c] = sum;
      sum += count;
    }
    // Filling moves every cell's start to its end, which is the next cell's start.
    for (uint32_t k = 0; k < num_samples_; ++k) {
      const uint32_t slot = memory_.first[memory_.slot[k]]++;
      memory_.slot[k] = slot;
      memory_.x[slot] = memory_.u[k];
      memory_.y[slot] = memory_.v[k];
    }
    for (uint32_t c = num_cells; c > 0; --c) memory_.first[c] = memory_.first[c - 1];
    memory_.first[0] = 0;
  }

  const PathSettings &settings_;
  const ReyesSettings &reyes_;
  const ReyesMemory &memory_;
  const uint32_t num_samples_;
  FilterTable table_{};
  SampleBlock block_{};
};

// The ray from the eye through the place of sample k of a bucket.
Ray ray_of_sample(const Camera &camera, const ReyesMemory &memory, const PathSample &s, uint32_t k)
{
  float depth_per_t;
  return camera_ray(camera, float(s.x) + memory.place_x[k], float(s.y) + memory.place_y[k], depth_per_t);
}

}  // namespace
GPURT_FUNCTIONS_END
}  // namespace gpurt
