// The talk's way to gather: a kd-tree of space whose leaves list the photons within a radius of them. A query walks down to
// its leaf and tests that list. A reference to compare the grid with: simple, and large.
//
// Source: Tatarinov and Kharlamov 2009. Differs: their tree is that of the scene's triangles, this one is of the photons.
#pragma once

#include "core/photon/map_query.h"
#include "core/photon/photon_source.h"

namespace gpurt {

struct PhotonNode {
  float split;
  uint32_t axis;   // 3: a leaf
  uint32_t first;  // inner: the child below the split, the other one follows it; leaf: the first of its list
  uint32_t count;  // leaf: photons of its list
};

/// Lists of photons of a grid, by their places there.
struct NodeLists {
  const PhotonNode *nodes;
  const uint32_t *photons;
};

/// Queries of a batch; arrays that are not wanted are null.
struct ListGather {
  PhotonGrid grid;
  NodeLists lists;
  RangeQuery range;
  const Vec3f *positions, *normals;
  uint32_t *counts;
  Vec3f *sums;
  const uint64_t *offsets;  // of each query's list, less first_listed
  uint64_t first_listed;
  uint32_t *ids;
  float *distances;
};

GPURT_FUNCTIONS_BEGIN

// Calls visit(i, d2, probe) for the photons of the point's leaf with d^2 < r^2, in the order of the grid.
template <class Visit>
GPURT_INLINE void gather_from_lists(const PhotonGrid &grid, const NodeLists &lists, Vec3f p, float radius,
                                    Visit &&visit)
{
  const float radius2 = radius * radius;
  PhotonNode node = lists.nodes[0];
  while (node.axis != 3) node = lists.nodes[node.first + (at(p, int(node.axis)) < node.split ? 0 : 1)];
  for (uint32_t k = 0; k < node.count; ++k) {
    const uint32_t i = lists.photons[node.first + k];
    const PhotonProbe probe = load_probe(grid, i);
    const float d2 = length2(probe.position - p);
    if (d2 < radius2) visit(i, d2, probe);
  }
}

// Answers one query of the batch: whatever it has arrays for.
GPURT_INLINE void answer_from_lists(const ListGather &gather, uint64_t query)
{
  const bool has_normals = gather.normals != nullptr;
  const uint32_t normal = has_normals ? encode_any_normal(gather.normals[query]) : 0u;
  uint64_t place = gather.offsets != nullptr ? gather.offsets[query] - gather.first_listed : 0;
  FluxSum parts[num_flux_parts] = {};
  gather_from_lists(
      gather.grid, gather.lists, gather.positions[query], gather.range.radius,
      [&](uint32_t i, float d2, const PhotonProbe &probe) {
        if (has_normals && normal_dot(normal, load_rest(gather.grid, i).normal) <= gather.range.min_dot)
          return;
        add(parts[has_normals ? i % num_flux_parts : 0], probe.flux, kernel_weight(gather.range, d2));
        if (gather.ids != nullptr) gather.ids[place] = photon_id(gather.grid, i, probe);
        if (gather.distances != nullptr) gather.distances[place] = sqrt(d2);
        ++place;
      });
  const FluxSum sum = has_normals ? join_parts(parts) : parts[0];
  if (gather.counts != nullptr) gather.counts[query] = sum.count;
  if (gather.sums != nullptr) gather.sums[query] = sum.flux * gather.range.flux_scale;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
