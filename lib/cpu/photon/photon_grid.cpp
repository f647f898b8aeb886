#include "cpu/photon/photon_grid.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>

#include "cpu/photon/radix_sort.h"

namespace gpurt {
namespace {

constexpr uint64_t photons_per_block = 1u << 14;

template <class Body>
void for_blocks(uint64_t n, Body &&body)
{
  tbb::parallel_for(tbb::blocked_range<uint64_t>(0, n, photons_per_block),
                    [&](const auto &range) { body(range.begin(), range.end()); });
}

int bits_of(uint32_t largest)
{
  int bits = 0;
  while (bits < 32 && largest >> bits != 0) ++bits;
  return bits;
}

}  // namespace

Box photon_bounds(const PhotonSource &source, uint64_t &first_bad)
{
  struct Found {
    Box bounds;
    uint64_t first_bad;
  };
  const Found found = tbb::parallel_reduce(
      tbb::blocked_range<uint64_t>(0, source.num_photons, photons_per_block),
      Found{empty_box(), source.num_photons},
      [&](const auto &range, Found so_far) {
        for (uint64_t i = range.begin(); i < range.end(); ++i) {
          const Vec3f p = source_position(source, i);
          if (is_finite(p)) so_far.bounds = extend(so_far.bounds, p);
          else so_far.first_bad = std::min(so_far.first_bad, i);
        }
        return so_far;
      },
      [](const Found &a, const Found &b) {
        return Found{extend(a.bounds, b.bounds), std::min(a.first_bad, b.first_bad)};
      });
  first_bad = found.first_bad;
  return found.bounds;
}

CpuPhotonGrid::CpuPhotonGrid(const PhotonSource &source, const Box &bounds, const PhotonGridOptions &options,
                             const std::shared_ptr<MemoryTracker> &memory)
    : shape_(make_grid_shape(bounds, options.radius, source.num_photons)), num_photons_(source.num_photons)
{
  const uint64_t n = num_photons_;
  starts_ = {memory, uint64_t(shape_.table_size) + 1, "a photon grid's cells"};
  probes_ = {memory, n, "a photon grid's photons"};
  if (options.keep_rests) rests_ = {memory, n, "a photon grid's photons"};
  if (options.keep_indices) indices_ = {memory, n, "a photon grid's photons"};

  TrackedArray<KeyValue> pairs(memory, n, "sorting photons"), scratch(memory, n, "sorting photons");
  for_blocks(n, [&](uint64_t begin, uint64_t end) {
    for (uint64_t i = begin; i < end; ++i)
      pairs[i] = {photon_entry(shape_, source_position(source, i)), uint32_t(i)};
  });
  const KeyValue *sorted =
      sort_pairs(pairs.data(), scratch.data(), n, bits_of(shape_.table_size - 1), memory);
  for_blocks(n, [&](uint64_t begin, uint64_t end) {
    for (uint64_t i = begin; i < end; ++i) {
      const uint32_t index = sorted[i].value;
      probes_[i] = options.ids_for_fluxes ? PhotonProbe{source_position(source, index), index}
                                          : source_probe(source, index);
      if (options.keep_rests) rests_[i] = source_rest(source, index);
      if (options.keep_indices) indices_[i] = index;
      // The first photon of an entry is that of all empty ones before it, too.
      const uint32_t entry = sorted[i].key;
      if (i != 0 && sorted[i - 1].key == entry) continue;
      for (uint64_t e = i == 0 ? 0 : uint64_t(sorted[i - 1].key) + 1; e <= entry; ++e)
        starts_[e] = uint32_t(i);
    }
  });
  const uint64_t first_empty = n == 0 ? 0 : uint64_t(sorted[n - 1].key) + 1;
  for_blocks(uint64_t(shape_.table_size) + 1 - first_empty, [&](uint64_t begin, uint64_t end) {
    std::fill(starts_.data() + first_empty + begin, starts_.data() + first_empty + end, uint32_t(n));
  });
}

PhotonGrid CpuPhotonGrid::view() const
{
  return {shape_,
          starts_.data(),
          probes_.data(),
          rests_.size() != 0 ? rests_.data() : nullptr,
          indices_.size() != 0 ? indices_.data() : nullptr,
          num_photons_};
}

}  // namespace gpurt
