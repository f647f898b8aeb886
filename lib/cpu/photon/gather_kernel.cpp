// Gathers, one query after another.
#include "core/photon/photon_source.h"
#include "cpu/photon/gather_table.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN
namespace {

// Calls visit(i, d2, probe, part) for the points that count.
template <bool Normals, class Visit>
GPURT_INLINE void gather_counted(const GatherBatch &batch, uint64_t query, Visit &&visit)
{
  const Vec3f p = batch.positions[query];
  const uint32_t normal = Normals ? encode_any_normal(batch.normals[query]) : 0u;
  const float radius2 = batch.range.radius * batch.range.radius;
  for_each_range(batch.grid, p, batch.range.radius, [&](uint32_t begin, uint32_t end) {
    for (uint32_t i = begin; i < end; ++i) {
      const PhotonProbe probe = batch.grid.probes[i];
      const float d2 = length2(probe.position - p);
      if (!(d2 < radius2)) continue;
      if (Normals && normal_dot(normal, batch.grid.rests[i].normal) <= batch.range.min_dot) continue;
      visit(i, d2, probe, i % num_flux_parts);
    }
  });
}

template <bool Normals>
void count(const GatherBatch &batch, uint64_t begin, uint64_t end)
{
  for (uint64_t i = begin; i < end; ++i) {
    uint32_t found = 0;
    gather_counted<Normals>(batch, batch.order[i],
                            [&](uint32_t, float, const PhotonProbe &, uint32_t) { ++found; });
    batch.counts[batch.order[i]] = found;
  }
}

template <bool Normals>
void sum(const GatherBatch &batch, uint64_t begin, uint64_t end)
{
  for (uint64_t i = begin; i < end; ++i) {
    const uint32_t query = batch.order[i];
    FluxSum parts[num_flux_parts] = {};
    gather_counted<Normals>(batch, query, [&](uint32_t, float d2, const PhotonProbe &probe, uint32_t part) {
      add(parts[Normals ? part : 0], probe.flux, kernel_weight(batch.range, d2));
    });
    const FluxSum whole = Normals ? join_parts(parts) : parts[0];
    batch.sums[query] = whole.flux * batch.range.flux_scale;
    if (batch.counts != nullptr) batch.counts[query] = whole.count;
  }
}

template <bool Normals>
void list(const GatherBatch &batch, uint64_t begin, uint64_t end)
{
  for (uint64_t i = begin; i < end; ++i) {
    const uint32_t query = batch.order[i];
    uint64_t place = batch.offsets[query];
    gather_counted<Normals>(batch, query, [&](uint32_t at, float d2, const PhotonProbe &probe, uint32_t) {
      if (batch.ids != nullptr) batch.ids[place] = photon_id(batch.grid, at, probe);
      if (batch.distances != nullptr) batch.distances[place] = sqrt(d2);
      ++place;
    });
  }
}

uint32_t collect(const PhotonGrid &grid, Vec3f p, float radius, uint32_t k, uint64_t *keys, uint32_t capacity,
                 ShrinkKeys shrink)
{
  float limit = radius * radius;
  uint32_t num = 0;
  for_each_range(grid, p, radius, [&](uint32_t begin, uint32_t end) {
    for (uint32_t i = begin; i < end; ++i) {
      const PhotonProbe probe = grid.probes[i];
      const float d2 = length2(probe.position - p);
      if (!(d2 < limit)) continue;
      if (num == capacity) {
        limit = shrink(keys, num, k);
        num = k;
        if (!(d2 < limit)) continue;
      }
      keys[num++] = nearest_key(d2, photon_id(grid, i, probe));
    }
  });
  return num;
}

void count_any(const GatherBatch &batch, uint64_t begin, uint64_t end)
{
  batch.normals != nullptr ? count<true>(batch, begin, end) : count<false>(batch, begin, end);
}
void sum_any(const GatherBatch &batch, uint64_t begin, uint64_t end)
{
  batch.normals != nullptr ? sum<true>(batch, begin, end) : sum<false>(batch, begin, end);
}
void list_any(const GatherBatch &batch, uint64_t begin, uint64_t end)
{
  batch.normals != nullptr ? list<true>(batch, begin, end) : list<false>(batch, begin, end);
}

}  // namespace

#define GPURT_STRING_OF(x) #x
#define GPURT_STRING(x) GPURT_STRING_OF(x)

const GatherKernels &gather_kernels_of_isa()
{
  static constexpr GatherKernels table = {GPURT_STRING(GPURT_ISA), count_any, sum_any, list_any, collect};
  return table;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
