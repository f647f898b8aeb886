// The sums of a film: of a whole frame, or of the rectangle that a work unit covers.
#pragma once

#include <cstdint>

#include "core/path/film_view.h"
#include "frame/zeroed_array.h"

namespace gpurt {

/// Bits of TileFilm::outputs that no gpurt_output has: sums that say what photon mapping's error is, and what it remembers.
constexpr uint32_t film_errors = 1u << 30, film_statistics = 1u << 31;

/// Film arrays in host memory; the optional ones are empty unless asked for.
struct TileFilm {
  uint32_t width = 0, height = 0;
  uint32_t outputs = 0;  // bits 1 << gpurt_output, film_errors and film_statistics
  ZeroedArray<PixelSums> pixels;
  ZeroedArray<PixelFeatures> features;    // mean normal and albedo
  ZeroedArray<PixelFirstHit> first_hits;  // of sample 0
  ZeroedArray<PixelErrors> errors;
  ZeroedArray<PixelStatistics> statistics;

  /// Resizes and clears.
  void reset(uint32_t w, uint32_t h, uint32_t wanted_outputs);
  /// Resizes alone: all is to be cleared or written before it is read.
  void reserve(uint32_t w, uint32_t h, uint32_t wanted_outputs);
  void clear();
  /// Has arrays for film_errors and film_statistics too, as `more` says.
  void add_outputs(uint32_t more);
  FilmView view();
  static bool has_errors(uint32_t wanted_outputs);
  uint64_t bytes() const;
  static uint64_t bytes_for(uint64_t num_pixels, uint32_t wanted_outputs);
};

/// Adds pixels [from, from + num_pixels) of `tile` to those of `frame` from `to` on; statistics take the place of older
/// ones. `tile` has what `frame` has.
void add_film_row(TileFilm &frame, uint64_t to, const TileFilm &tile, uint64_t from, uint32_t num_pixels);

/// Adds `tile` at (x0, y0) of `frame`.
void add_film(TileFilm &frame, const TileFilm &tile, uint32_t x0, uint32_t y0);

}  // namespace gpurt
