// Gathers over a batch of queries, as they are compiled once per instruction set.
#pragma once

#include "core/photon/map_query.h"

namespace gpurt {

/// A batch of range queries over one grid; arrays that are not wanted are null.
struct GatherBatch {
  PhotonGrid grid;
  RangeQuery range;
  const Vec3f *positions, *normals;
  const uint32_t *order;  // in which queries are answered
  uint32_t *counts = nullptr;
  Vec3f *sums = nullptr;
  const uint64_t *offsets = nullptr;  // of each query's list
  uint32_t *ids = nullptr;
  float *distances = nullptr;
};

/// Keeps the `k` smallest of `num` keys, and returns what a point's d^2 must be less than to be of use from then on.
using ShrinkKeys = float (*)(uint64_t *keys, uint32_t num, uint32_t k);

struct GatherKernels {
  const char *isa;
  /// Queries order[begin .. end).
  void (*count)(const GatherBatch &batch, uint64_t begin, uint64_t end);
  void (*sum)(const GatherBatch &batch, uint64_t begin, uint64_t end);
  void (*list)(const GatherBatch &batch, uint64_t begin, uint64_t end);
  /// Collects nearest_key of the points within the radius in keys[capacity], which `shrink` makes room in. Returns their
  /// number; where it is k or more, the k nearest are among them.
  uint32_t (*collect)(const PhotonGrid &grid, Vec3f p, float radius, uint32_t k, uint64_t *keys,
                      uint32_t capacity, ShrinkKeys shrink);
};

/// Those that this machine runs (accel/isa.h).
const GatherKernels &gather_kernels();

}  // namespace gpurt
