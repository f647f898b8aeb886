// What kernels of other instruction sets leave to vectors of 512 bits, where the processor has them.
#pragma once

#include <cstdint>

namespace gpurt {

struct Grid;
struct GridLight;
struct GridMiddles;
struct PlacedRows;
struct SampleBlock;

// A grid in front of the eye, and what its micropolygons leave in samples.
struct WideGrid {
  const Grid &grid;
  const SampleBlock &block;
  uint32_t root;
  const GridLight *light;      // null, or what samples keep in place of the root
  const GridMiddles *middles;  // null, or what they keep in place of where the micropolygons are on the patch
  bool takes_all;              // nothing is looked up of what is nearer
  // The rest, micropolygon (i, j) by micropolygon: those that are not tiny, or folded; and a sample that has a surface as
  // near, or where something is to be looked up.
  void *sampler;
  void (*sample_quad)(void *sampler, uint32_t i, uint32_t j);
  void (*take)(void *sampler, uint32_t i, uint32_t j, uint32_t slot, float z, float u, float v);
};

struct WideKernels {
  /// Puts the micropolygons of a grid into the samples. Returns how many it took itself.
  uint64_t (*sample_grid)(const WideGrid &grid);
  /// Finds the places of a bucket's samples and sorts them.
  void (*place_rows)(const PlacedRows &rows);
};

/// Those for an instruction set variant, by its name; null: it has none.
const WideKernels *wide_kernels(const char *isa_name);

}  // namespace gpurt
