// The .gpurt file: a frame's sums, exact, with all that says which image they belong to.
//
// Layout, little-endian: magic "gpurtfrm", format version, header (see state_file.cpp), its checksum; row by row the pixels' sums,
// features, first hits, errors, statistics and sample sets; the table of sample sets; a 64-bit checksum of everything before it.
#pragma once

#include <functional>
#include <string>

#include "frame/frame.h"

namespace gpurt {

/// Hands out one row of the film at a time; the row stays unchanged until the sink returns.
struct FilmRow {
  const PixelSums *pixels;
  const PixelFeatures *features;      // or null
  const PixelFirstHit *first_hits;    // or null
  const PixelErrors *errors;          // or null
  const PixelStatistics *statistics;  // or null
  const uint32_t *sample_sets;
};
using RowSource = std::function<void(uint32_t y, const std::function<void(const FilmRow &)> &sink)>;

/// Writes the file: `header` gives everything but the arrays, `rows` the arrays, `sets` the table, which is asked for
/// last, so that it has all entries that the rows name. Throws IO.
void write_state(const std::string &path, const FrameState &header, const RowSource &rows,
                 const std::function<SampleSets()> &sets);

/// Reads the head of a file alone: everything but the arrays. Throws IO.
FrameState read_state_header(const std::string &path);

/// Reads a file. `check` sees the header before memory for the arrays is taken from `memory`, and throws where the
/// state is not wanted. Throws IO with one line for a file that is foreign, damaged or of another version.
struct LoadedState {
  FrameState state;
  Reservation memory;
};
LoadedState read_state(const std::string &path, const std::shared_ptr<MemoryTracker> &memory,
                       const std::function<void(const FrameState &header)> &check);

}  // namespace gpurt
