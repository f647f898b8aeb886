// Sorts photons into a grid: a stable radix sort of (entry, index), and one kernel that moves photons to their places and
// writes where entries start. The grid has the same bytes as the one that the CPU builds.
#include <cub/device/device_radix_sort.cuh>

#include "cuda/launch.h"
#include "cuda/photon/flight.h"
#include "cuda/photon/kernels.h"

namespace gpurt::cuda {
namespace {

// Empty entries before a photon's: those of short gaps are filled by its thread, of longer ones by its warp, and of the
// longest piece by piece by the blocks of a kernel of their own.
constexpr uint32_t max_thread_gap = 4, max_warp_gap = 4096, gap_piece = 1u << 14;

struct Gap {
  uint32_t begin, end;  // entries that start at
  uint32_t value;
};

constexpr uint64_t align(uint64_t bytes) { return (bytes + 255) / 256 * 256; }

// Where a build's working memory goes.
struct Layout {
  uint64_t keys, indices, sorted_keys, sorted_indices, gaps, num_gaps, sort, end;
  size_t sort_bytes;
};

int bits_of(uint32_t largest)
{
  int bits = 1;
  while (bits < 32 && largest >> bits != 0) ++bits;
  return bits;
}

Layout layout_of(uint32_t table_size, uint64_t n)
{
  const uint64_t words = align(n * sizeof(uint32_t));
  Layout layout{};
  layout.keys = 0;
  layout.indices = words;
  layout.sorted_keys = 2 * words;
  layout.sorted_indices = 3 * words;
  layout.gaps = 4 * words;
  // A gap has a piece that is not full, at most.
  const uint64_t most_gaps = table_size / max_warp_gap + table_size / gap_piece + 2;
  layout.num_gaps = layout.gaps + align(most_gaps * sizeof(Gap));
  layout.sort = layout.num_gaps + 256;
  const uint32_t *from = nullptr;
  uint32_t *to = nullptr;
  check(cub::DeviceRadixSort::SortPairs(nullptr, layout.sort_bytes, from, to, from, to, uint32_t(n), 0,
                                        bits_of(table_size - 1)),
        "cub::DeviceRadixSort::SortPairs");
  layout.end = layout.sort + align(layout.sort_bytes);
  return layout;
}

__global__ void __launch_bounds__(block_size)
    key_kernel(const __grid_constant__ GridShape shape, const __grid_constant__ PhotonSource source,
               bool has_slots, uint32_t *keys, uint32_t *indices)
{
  const uint64_t i = thread_item();
  if (i >= source.num_photons) return;
  const uint32_t slot = has_slots ? source.records[i].bounce >> slot_shift : 0;
  // Of records a whole sector is read: positions that lie apart are the shorter way.
  const Vec3f p = source.positions != nullptr ? source.positions[i] : source.records[i].position;
  keys[i] = slot * shape.table_size + photon_entry(shape, p);
  indices[i] = uint32_t(i);
}

// Sets starts[begin .. end) to value, or leaves that to others. Called by all lanes of a warp.
__device__ void fill_gap(uint32_t *starts, Gap gap, Gap *gaps, uint32_t *num_gaps)
{
  const uint32_t length = gap.end - gap.begin;
  if (length <= max_thread_gap) {
    for (uint32_t e = gap.begin; e < gap.end; ++e) starts[e] = gap.value;
  } else if (length > max_warp_gap) {
    uint32_t place = atomicAdd(num_gaps, (length + gap_piece - 1) / gap_piece);
    for (uint32_t e = gap.begin; e < gap.end; e += gap_piece)
      gaps[place++] = {e, min(e + gap_piece, gap.end), gap.value};
  }
  unsigned waiting = __ballot_sync(~0u, length > max_thread_gap && length <= max_warp_gap);
  while (waiting != 0) {
    const int from = __ffs(int(waiting)) - 1;
    waiting &= waiting - 1;
    const uint32_t begin = __shfl_sync(~0u, gap.begin, from), end = __shfl_sync(~0u, gap.end, from);
    const uint32_t value = __shfl_sync(~0u, gap.value, from);
    for (uint32_t e = begin + threadIdx.x % 32; e < end; e += 32) starts[e] = value;
  }
}

template <bool Records>
__global__ void __launch_bounds__(block_size)
    place_kernel(const __grid_constant__ PhotonSource source, const uint32_t *keys, const uint32_t *indices,
                 const __grid_constant__ GridTarget target, uint32_t table_size, Gap *gaps,
                 uint32_t *num_gaps)
{
  const uint64_t i = thread_item();
  Gap before{}, after{};  // empty entries; none
  if (i < source.num_photons) {
    const uint32_t index = indices[i], key = keys[i];
    float4 probe, rest{};
    if constexpr (Records) {
      const float4 *record = reinterpret_cast<const float4 *>(source.records + index);
      probe = __ldcs(record);
      if (target.rests != nullptr) rest = __ldcs(record + 1);
    } else {
      const Vec3f p = source.positions[index];
      probe = {p.x, p.y, p.z, 0.0f};
    }
    if (target.ids_for_fluxes) probe.w = __uint_as_float(index);
    reinterpret_cast<float4 *>(target.probes)[i] = probe;
    if (Records && target.rests != nullptr) reinterpret_cast<float2 *>(target.rests)[i] = {rest.x, rest.y};
    if (target.indices != nullptr) target.indices[i] = index;
    // The first photon of an entry is that of all empty ones before it, too; those after the last photon hold none.
    const uint32_t first = i == 0 ? 0 : keys[i - 1] + 1;
    if (first <= key) before = {first, key + 1, uint32_t(i)};
    if (i + 1 == source.num_photons) after = {key + 1, table_size + 1, uint32_t(source.num_photons)};
  }
  fill_gap(target.starts, before, gaps, num_gaps);
  if (__any_sync(~0u, after.end != 0)) fill_gap(target.starts, after, gaps, num_gaps);
}

__global__ void __launch_bounds__(block_size)
    gap_kernel(uint32_t *starts, const Gap *gaps, const uint32_t *num_gaps)
{
  const uint32_t num = *num_gaps;
  for (uint32_t g = blockIdx.x; g < num; g += gridDim.x) {
    const Gap gap = gaps[g];
    for (uint32_t e = gap.begin + threadIdx.x; e < gap.end; e += block_size) starts[e] = gap.value;
  }
}

__global__ void __launch_bounds__(block_size)
    read_kernel(const __grid_constant__ PhotonGrid grid, bool has_fluxes, Photon *records)
{
  const uint64_t i = thread_item();
  if (i >= grid.num_photons) return;
  const PhotonProbe probe = grid.probes[i];
  const uint32_t id = photon_id(grid, uint32_t(i), probe);
  const PhotonRest rest = grid.rests != nullptr ? grid.rests[i] : PhotonRest{0, 0};
  records[id] = {probe.position, has_fluxes ? probe.flux : 0u, rest.direction, rest.normal, id, 0};
}

}  // namespace

uint64_t grid_build_bytes(const GridShape &shape, uint64_t num_photons, uint32_t num_slots)
{
  return layout_of(shape.table_size * num_slots, num_photons).end;
}

void launch_build_grid(const GridShape &shape, const PhotonSource &source, const GridTarget &target,
                       void *memory, cudaStream_t stream, uint32_t num_slots)
{
  const uint32_t table_size = shape.table_size * num_slots;
  if (source.num_photons == 0) {
    check(cudaMemsetAsync(target.starts, 0, (uint64_t(table_size) + 1) * sizeof(uint32_t), stream),
          "cudaMemsetAsync");
    return;
  }
  const Layout layout = layout_of(table_size, source.num_photons);
  std::byte *const base = static_cast<std::byte *>(memory);
  const auto words = [&](uint64_t at) { return reinterpret_cast<uint32_t *>(base + at); };
  const uint64_t n = source.num_photons;
  launch("kernel that numbers the cells of photons", key_kernel, n, stream, shape, source, num_slots > 1,
         words(layout.keys), words(layout.indices));
  size_t sort_bytes = layout.sort_bytes;
  check(cub::DeviceRadixSort::SortPairs(base + layout.sort, sort_bytes, words(layout.keys),
                                        words(layout.sorted_keys), words(layout.indices),
                                        words(layout.sorted_indices), uint32_t(n), 0, bits_of(table_size - 1),
                                        stream),
        "cub::DeviceRadixSort::SortPairs");
  check(cudaMemsetAsync(base + layout.num_gaps, 0, sizeof(uint32_t), stream), "cudaMemsetAsync");
  Gap *const gaps = reinterpret_cast<Gap *>(base + layout.gaps);
  if (source.records != nullptr) {
    launch("kernel that places photons", place_kernel<true>, n, stream, source, words(layout.sorted_keys),
           words(layout.sorted_indices), target, table_size, gaps, words(layout.num_gaps));
  } else {
    launch("kernel that places points", place_kernel<false>, n, stream, source, words(layout.sorted_keys),
           words(layout.sorted_indices), target, table_size, gaps, words(layout.num_gaps));
  }
  launch_blocks("kernel that fills empty cells", gap_kernel, 512, block_size, stream, target.starts, gaps,
                words(layout.num_gaps));
}

void launch_read_grid(const PhotonGrid &grid, bool has_fluxes, Photon *records, cudaStream_t stream)
{
  launch("kernel that reads photons", read_kernel, grid.num_photons, stream, grid, has_fluxes, records);
}

}  // namespace gpurt::cuda
