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
  int min_dot;       // of normals: normal_threshold
  float flux_scale;  // of the map: what sums are multiplied with
};

/// A sum over points within a radius.
struct FluxSum {
  Vec3f flux;
  uint32_t count;
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE RangeQuery make_range_query(float radius, GatherKernel kernel, float min_cosine,
                                         float flux_scale)
{
  return {radius, 1.0f / radius, 1.0f / (radius * radius), kernel, normal_threshold(min_cosine), flux_scale};
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
  // The unit is a power of 2: it does not matter what it is multiplied with first.
  const float unit = flux_unit(flux_code) * weight;
  sum.flux = {fma(byte_to_float(flux_code, 0), unit, sum.flux.x),
              fma(byte_to_float(flux_code, 1), unit, sum.flux.y),
              fma(byte_to_float(flux_code, 2), unit, sum.flux.z)};
  ++sum.count;
}

// Sums that test normals are made of this many parts: photon i of the grid goes to part i mod 4. So four lanes of a warp
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
  float radius;  // of the next gather
  float limit;   // points farther away do not count; infinite: all may
};

GPURT_INLINE bool is_within(const Box &b, Vec3f p)
{
  return p.x >= b.lo.x && p.y >= b.lo.y && p.z >= b.lo.z && p.x <= b.hi.x && p.y <= b.hi.y && p.z <= b.hi.z;
}

// `hint`: about what holds k points; 0: not known.
GPURT_INLINE NearestSearch begin_nearest(const PhotonLevels &levels, Vec3f p, uint32_t k, float limit,
                                         float hint)
{
  const GridShape &shape = levels.grids[0].shape;
  NearestSearch search = {hint, limit};
  if (!(hint > 0.0f)) {
    search.radius = 1.2f * shape.cell;
    // Where the cell of the point is crowded, a part of it holds enough.
    const uint32_t entry = query_entry(shape, p);
    const uint32_t crowd = load_start(levels.grids[0], entry + 1) - load_start(levels.grids[0], entry);
    if (crowd > k) search.radius = max(search.radius * rough_sqrt(float(k) / float(crowd)), 0x1.8p-62f);
  }
  if (!is_within(levels.bounds, p)) {
    const Vec3f outside = max(max(levels.bounds.lo - p, p - levels.bounds.hi), Vec3f{0, 0, 0});
    search.radius += length(outside) * reach_widening;
  }
  search.radius = min(search.radius, limit);
  return search;
}

// After a gather that found fewer than k points within the radius. Returns false where there are no more.
GPURT_INLINE bool grow(const PhotonLevels &levels, Vec3f p, NearestSearch &search, uint32_t found, uint32_t k)
{
  // The farthest corner of the bounds, rounded up. As a radius, it must be larger than any distance, also where all points
  // lie at p.
  const Vec3f farthest = max(abs(levels.bounds.lo - p), abs(levels.bounds.hi - p));
  const float whole = min(search.limit, max(next_up(length(farthest) * reach_widening), 0x1p-60f));
  if (!(search.radius < whole)) return false;
  // As if points lay on a surface, and a little more, since every gather starts again.
  const float ratio = found == 0 ? 4.0f : rough_sqrt(float(k) / float(found)) * 1.15f;
  search.radius = min(search.radius * clamp(ratio, 1.3f, 4.0f), whole);
  return true;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
