// Queries of a photon map: what a point within the radius counts, and how far a search for the nearest ones goes.
#pragma once

#include "core/photon/grid.h"

namespace gpurt {

enum class GatherKernel : uint32_t {
  Constant = 0,
  Cone = 1,
  Quadratic = 2
};  // values of gpurt_gather_kernel

constexpr uint32_t max_photon_levels = 8;
constexpr uint32_t level_ratio = 4;  // of the cells of neighbouring levels

/// Grids over the same points, each coarser than the one before. Grids without indices keep the ids of points in place of
/// their fluxes.
struct PhotonLevels {
  PhotonGrid grids[max_photon_levels];
  uint32_t num;
  Box bounds;
};

/// What a query asks for, the same for every point of a batch.
struct RangeQuery {
  float radius;
  float inverse_radius, inverse_radius2;
  GatherKernel kernel;
  int min_dot;  // of normals: normal_threshold
};

/// A sum over points within a radius.
struct FluxSum {
  Vec3f flux;
  uint32_t count;
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE RangeQuery make_range_query(float radius, GatherKernel kernel, float min_cosine)
{
  return {radius, 1.0f / radius, 1.0f / (radius * radius), kernel, normal_threshold(min_cosine)};
}

GPURT_INLINE float kernel_weight(const RangeQuery &query, float d2)
{
  switch (query.kernel) {
    case GatherKernel::Cone:
      return max(fma(-sqrt(d2), query.inverse_radius, 1.0f), 0.0f);
    case GatherKernel::Quadratic:
      return max(fma(-d2, query.inverse_radius2, 1.0f), 0.0f);
    default:
      return 1.0f;
  }
}

GPURT_INLINE void add(FluxSum &sum, uint32_t flux_code, float weight)
{
  const Vec3f flux = decode_flux(flux_code);
  sum.flux = {fma(flux.x, weight, sum.flux.x), fma(flux.y, weight, sum.flux.y),
              fma(flux.z, weight, sum.flux.z)};
  ++sum.count;
}

// Sums that test normals are made of this many parts: photon i of a range goes to part i mod 4. So four lanes of a warp
// can share a query, and a single thread gets the same bits.
constexpr uint32_t num_flux_parts = 4;

GPURT_INLINE FluxSum join(const FluxSum &a, const FluxSum &b) { return {a.flux + b.flux, a.count + b.count}; }
GPURT_INLINE FluxSum join_parts(const FluxSum (&parts)[num_flux_parts])
{
  return join(join(parts[0], parts[1]), join(parts[2], parts[3]));
}

/// The id of a photon of a grid.
GPURT_INLINE uint32_t photon_id(const PhotonGrid &grid, uint32_t i, const PhotonProbe &probe)
{
  return grid.indices != nullptr ? grid.indices[i] : probe.flux;
}

// The level whose rows fit a radius best: of cells that are larger than it, a gather sees more than it finds, and of
// smaller ones it sees many rows.
GPURT_INLINE uint32_t level_for(const PhotonLevels &levels, float radius)
{
  uint32_t level = 0;
  while (level + 1 < levels.num && radius > 2.5f * levels.grids[level].shape.cell) ++level;
  return level;
}

// Squared distances are not negative: their order is that of their bits.
GPURT_INLINE uint64_t nearest_key(float d2, uint32_t id) { return uint64_t(float_bits(d2)) << 32 | id; }
GPURT_INLINE float key_distance2(uint64_t key) { return float_from_bits(uint32_t(key >> 32)); }

/// A search for the k nearest points by gathers within growing radii. Once a gather finds k points they are the nearest.
struct NearestSearch {
  float radius;        // of the next gather
  float whole_radius;  // within which all points that may count lie
};

// `limit`: points farther away do not count; infinite: all may. `hint`: about what holds k points; 0: not known.
GPURT_INLINE NearestSearch begin_nearest(const PhotonLevels &levels, Vec3f p, float limit, float hint)
{
  // Distances to the nearest and the farthest corner of the bounds, rounded up.
  const Vec3f below = levels.bounds.lo - p, above = p - levels.bounds.hi;
  const Vec3f outside = max(max(below, above), Vec3f{0, 0, 0}), farthest = max(abs(below), abs(above));
  const float to_bounds = length(outside) * reach_widening, all = length(farthest) * reach_widening;
  NearestSearch search;
  // Larger than any distance, as a radius must be: also where all points lie at p.
  search.whole_radius = min(limit, max(next_up(all), 0x1p-60f));
  const float first = (hint > 0.0f ? hint : levels.grids[0].shape.cell * 1.2f) + to_bounds;
  search.radius = min(first, search.whole_radius);
  return search;
}

// After a gather that found fewer than k points within the radius. Returns false where there are no more.
GPURT_INLINE bool grow(NearestSearch &search, uint32_t found, uint32_t k)
{
  if (!(search.radius < search.whole_radius)) return false;
  // As if points lay on a surface, and a little more, since every gather starts again.
  const float ratio = found == 0 ? 4.0f : sqrt(float(k) / float(found)) * 1.15f;
  search.radius = min(search.radius * clamp(ratio, 1.3f, 4.0f), search.whole_radius);
  return true;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
