#include "frame/film.h"

#include "gpurt.h"

namespace gpurt {

namespace {

constexpr uint32_t feature_outputs = 1u << GPURT_OUTPUT_NORMAL | 1u << GPURT_OUTPUT_ALBEDO;
constexpr uint32_t first_hit_outputs = 1u << GPURT_OUTPUT_DEPTH | 1u << GPURT_OUTPUT_POSITION |
                                       1u << GPURT_OUTPUT_PRIMITIVE | 1u << GPURT_OUTPUT_INSTANCE;

constexpr uint32_t error_outputs = film_errors | 1u << GPURT_OUTPUT_BIAS | 1u << GPURT_OUTPUT_ERROR;

bool has_samples(const PixelSums &p) { return (p.num_samples[0] | p.num_samples[1] | p.num_nonfinite) != 0; }

}  // namespace

void TileFilm::reset(uint32_t w, uint32_t h, uint32_t wanted_outputs)
{
  reserve(w, h, wanted_outputs);
  clear();
}

void TileFilm::reserve(uint32_t w, uint32_t h, uint32_t wanted_outputs)
{
  const size_t num_pixels = size_t(w) * h;
  width = w;
  height = h;
  outputs = wanted_outputs;
  pixels.reserve(num_pixels);
  features.reserve(wanted_outputs & feature_outputs ? num_pixels : 0);
  first_hits.reserve(wanted_outputs & first_hit_outputs ? num_pixels : 0);
  errors.reserve(wanted_outputs & error_outputs ? num_pixels : 0);
  statistics.reserve(wanted_outputs & film_statistics ? num_pixels : 0);
}

void TileFilm::clear()
{
  pixels.clear();
  features.clear();
  first_hits.clear();
  errors.clear();
  statistics.clear();
}

void TileFilm::add_outputs(uint32_t more)
{
  if (more & film_errors && errors.empty()) errors.reset(pixels.size());
  if (more & film_statistics && statistics.empty()) statistics.reset(pixels.size());
  outputs |= more;
}

FilmView TileFilm::view()
{
  return {pixels.data(),
          features.empty() ? nullptr : features.data(),
          first_hits.empty() ? nullptr : first_hits.data(),
          width,
          height,
          errors.empty() ? nullptr : errors.data(),
          statistics.empty() ? nullptr : statistics.data()};
}

bool TileFilm::has_errors(uint32_t wanted_outputs) { return (wanted_outputs & error_outputs) != 0; }

uint64_t TileFilm::bytes() const { return bytes_for(pixels.size(), outputs); }

uint64_t TileFilm::bytes_for(uint64_t num_pixels, uint32_t wanted_outputs)
{
  uint64_t bytes = sizeof(PixelSums);
  if (wanted_outputs & feature_outputs) bytes += sizeof(PixelFeatures);
  if (wanted_outputs & first_hit_outputs) bytes += sizeof(PixelFirstHit);
  if (wanted_outputs & error_outputs) bytes += sizeof(PixelErrors);
  if (wanted_outputs & film_statistics) bytes += sizeof(PixelStatistics);
  return num_pixels * bytes;
}

void add_film_row(TileFilm &frame, uint64_t to, const TileFilm &tile, uint64_t from, uint32_t num_pixels)
{
  for (uint32_t i = 0; i < num_pixels; ++i) add(frame.pixels[to + i], tile.pixels[from + i]);
  if (!frame.features.empty()) {
    for (uint32_t i = 0; i < num_pixels; ++i) {
      PixelFeatures &sum = frame.features[to + i];
      const PixelFeatures &other = tile.features[from + i];
      for (int c = 0; c < 3; ++c) {
        sum.normal[c] += other.normal[c];
        sum.albedo[c] += other.albedo[c];
      }
    }
  }
  // A frame without samples may lack what others have.
  if (!frame.errors.empty() && !tile.errors.empty()) {
    for (uint32_t i = 0; i < num_pixels; ++i) add(frame.errors[to + i], tile.errors[from + i]);
  }
  if (!frame.statistics.empty() && !tile.statistics.empty()) {
    for (uint32_t i = 0; i < num_pixels; ++i) {
      if (has_samples(tile.pixels[from + i])) frame.statistics[to + i] = tile.statistics[from + i];
    }
  }
  if (!frame.first_hits.empty()) {
    for (uint32_t i = 0; i < num_pixels; ++i) {
      if (tile.first_hits[from + i].is_set) frame.first_hits[to + i] = tile.first_hits[from + i];
    }
  }
}

void add_film(TileFilm &frame, const TileFilm &tile, uint32_t x0, uint32_t y0)
{
  for (uint32_t y = 0; y < tile.height; ++y) {
    add_film_row(frame, uint64_t(y0 + y) * frame.width + x0, tile, uint64_t(y) * tile.width, tile.width);
  }
}

}  // namespace gpurt
