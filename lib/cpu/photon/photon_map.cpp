#include "cpu/photon/photon_map.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <chrono>

#include "cpu/photon/gather_table.h"
#include "cpu/photon/radix_sort.h"

namespace gpurt {
namespace {

constexpr uint64_t points_per_block = 1u << 14;
constexpr uint64_t queries_per_block = 256;
// Fewer queries than this are not worth sorting.
constexpr uint64_t min_sorted_queries = 1024;
// Queries that are sorted together, which bounds the memory that it takes.
constexpr uint64_t queries_per_slice = uint64_t(1) << 22;

bool is_flux(Vec3f f) { return f.x >= 0 && f.y >= 0 && f.z >= 0 && max_component(f) <= max_photon_flux; }

PointsFound look_through(const PhotonSource &source)
{
  return tbb::parallel_reduce(
      tbb::blocked_range<uint64_t>(0, source.num_photons, points_per_block),
      PointsFound{empty_box(), UINT64_MAX, UINT64_MAX, UINT64_MAX},
      [&](const auto &range, PointsFound found) {
        for (uint64_t i = range.begin(); i < range.end(); ++i) {
          const Vec3f p = source_position(source, i);
          if (is_finite(p)) found.bounds = extend(found.bounds, p);
          else found.bad_position = std::min(found.bad_position, i);
          if (source.fluxes && !is_flux(source.fluxes[i])) found.bad_flux = std::min(found.bad_flux, i);
          if (source.normals && !is_finite(source.normals[i]))
            found.bad_normal = std::min(found.bad_normal, i);
        }
        return found;
      },
      [](const PointsFound &a, const PointsFound &b) {
        return PointsFound{extend(a.bounds, b.bounds), std::min(a.bad_position, b.bad_position),
                           std::min(a.bad_flux, b.bad_flux), std::min(a.bad_normal, b.bad_normal)};
      });
}

struct Fill {
  uint64_t sum_of_squares;  // of the entries' numbers of points
  uint32_t fullest;
};

Fill fill_of(const PhotonGrid &grid)
{
  return tbb::parallel_reduce(
      tbb::blocked_range<uint64_t>(0, grid.shape.table_size, points_per_block), Fill{0, 0},
      [&](const auto &range, Fill fill) {
        for (uint64_t e = range.begin(); e < range.end(); ++e) {
          const uint32_t n = grid.starts[e + 1] - grid.starts[e];
          fill.sum_of_squares += uint64_t(n) * n;
          fill.fullest = std::max(fill.fullest, n);
        }
        return fill;
      },
      [](Fill a, Fill b) {
        return Fill{a.sum_of_squares + b.sum_of_squares, std::max(a.fullest, b.fullest)};
      });
}

// The order in which a batch is answered: by the cells of the grid, so that neighbours share what they load.
class QueryOrder {
 public:
  QueryOrder(const PhotonGrid &grid, const PhotonQuery &query, uint64_t begin, uint64_t end,
             const std::shared_ptr<MemoryTracker> &memory)
      : order_(memory, end - begin, "sorting queries")
  {
    const uint64_t n = end - begin;
    if (query.is_coherent || n < min_sorted_queries) {
      for (uint64_t i = 0; i < n; ++i) order_[i] = uint32_t(i);
      return;
    }
    TrackedArray<KeyValue> pairs(memory, n, "sorting queries"), scratch(memory, n, "sorting queries");
    const auto for_all = [&](auto &&body) {
      tbb::parallel_for(tbb::blocked_range<uint64_t>(0, n, points_per_block), [&](const auto &range) {
        for (uint64_t i = range.begin(); i < range.end(); ++i) body(i);
      });
    };
    for_all(
        [&](uint64_t i) { pairs[i] = {query_entry(grid.shape, query.positions[begin + i]), uint32_t(i)}; });
    int bits = 0;
    while (bits < 32 && (grid.shape.table_size - 1) >> bits != 0) ++bits;
    const KeyValue *sorted = sort_pairs(pairs.data(), scratch.data(), n, bits, memory);
    for_all([&](uint64_t i) { order_[i] = sorted[i].value; });
  }
  const uint32_t *data() const { return order_.data(); }

 private:
  TrackedArray<uint32_t> order_;
};

// Calls run(begin, end) for parts of the places of a slice, by all threads.
template <class Run>
void run_all(uint64_t n, Run &&run)
{
  tbb::parallel_for(tbb::blocked_range<uint64_t>(0, n, queries_per_block),
                    [&](const auto &range) { run(range.begin(), range.end()); });
}

// Counts become offsets: entry i + 1 of `offsets` is that of query i before, and the sum through query i after.
void sum_up(uint64_t *offsets, uint64_t n)
{
  for (uint64_t i = 0; i < n; ++i) offsets[i + 1] += offsets[i];
}

float shrink(uint64_t *keys, uint32_t num, uint32_t k)
{
  std::nth_element(keys, keys + (k - 1), keys + num);
  // One that is as far away as the k-th may still have a smaller id.
  return next_up(key_distance2(keys[k - 1]));
}

}  // namespace

CpuPhotonMap::CpuPhotonMap(const PhotonMapRequest &request, std::shared_ptr<tbb::task_arena> arena,
                           std::shared_ptr<MemoryTracker> memory)
    : arena_(std::move(arena)), memory_(std::move(memory))
{
  arena_->execute([&] { build(request); });
}

void CpuPhotonMap::build(const PhotonMapRequest &request)
{
  const auto start = std::chrono::steady_clock::now();
  const PhotonSource &source = request.source;
  const PointsFound found = look_through(source);
  check_points(found);
  facts_ = facts_of(request, found.bounds);
  if (request.radius == 0) {
    facts_.radius = choose_radius(found.bounds, source.num_photons, [&](float radius) {
      const CpuPhotonGrid grid(source, found.bounds, {radius, false, false}, memory_);
      return double(fill_of(grid.view()).sum_of_squares) / double(source.num_photons);
    });
  }
  float radius = facts_.radius;
  for (uint32_t level = 0; level < request.num_levels; ++level, radius *= float(level_ratio)) {
    const bool keeps_flux = level == 0 && request.has_fluxes;
    const PhotonGridOptions options = {radius, level == 0 && request.has_normals, keeps_flux, !keeps_flux};
    grids_.emplace_back(source, found.bounds, options, memory_);
    levels_.grids[level] = grids_.back().view();
    facts_.bytes += grids_.back().bytes();
  }
  levels_.num = request.num_levels;
  levels_.bounds = found.bounds;
  facts_.fullest_cell = fill_of(levels_.grids[0]).fullest;
  facts_.build_seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

void CpuPhotonMap::query(const PhotonQuery &query) const
{
  arena_->execute([&] {
    if (query.kind == PhotonQueryKind::Nearest) find_nearest(query);
    else gather(query);
  });
}

void CpuPhotonMap::gather(const PhotonQuery &query) const
{
  if (query.method == GatherMethod::NodeLists) return gather_from_node_lists(query);
  // Fluxes and normals are the finest level's alone.
  const bool needs_payload = query.kind == PhotonQueryKind::Sum || query.normals != nullptr;
  const PhotonGrid &grid = levels_.grids[needs_payload ? 0 : level_for(levels_, query.range.radius)];
  const GatherKernels &kernels = gather_kernels();
  const auto for_slices = [&](auto &&run) {
    for (uint64_t begin = 0; begin < query.num_queries; begin += queries_per_slice) {
      const uint64_t end = std::min(begin + queries_per_slice, query.num_queries);
      const QueryOrder order(grid, query, begin, end, memory_);
      GatherBatch batch = {grid, query.range, query.positions + begin,
                           query.normals != nullptr ? query.normals + begin : nullptr, order.data()};
      if (query.counts != nullptr) batch.counts = query.counts + begin;
      if (query.sums != nullptr) batch.sums = query.sums + begin;
      run(batch, begin, end - begin);
    }
  };
  switch (query.kind) {
    case PhotonQueryKind::Count:
      return for_slices([&](const GatherBatch &batch, uint64_t, uint64_t n) {
        run_all(n, [&](uint64_t a, uint64_t b) { kernels.count(batch, a, b); });
      });
    case PhotonQueryKind::Sum:
      return for_slices([&](const GatherBatch &batch, uint64_t, uint64_t n) {
        run_all(n, [&](uint64_t a, uint64_t b) { kernels.sum(batch, a, b); });
      });
    default:
      break;
  }
  query.offsets[0] = 0;
  const TrackedArray<uint32_t> counts(memory_, std::min(query.num_queries, queries_per_slice),
                                      "a slice of queries");
  uint64_t total = 0;
  for_slices([&](const GatherBatch &first, uint64_t begin, uint64_t n) {
    GatherBatch batch = first;
    batch.counts = const_cast<uint32_t *>(counts.data());
    run_all(n, [&](uint64_t a, uint64_t b) { kernels.count(batch, a, b); });
    for (uint64_t i = 0; i < n; ++i) query.offsets[begin + i + 1] = batch.counts[i];
    sum_up(query.offsets + begin, n);
    total = query.offsets[begin + n];
    if ((query.ids == nullptr && query.distances == nullptr) || total > query.capacity) return;
    batch.offsets = query.offsets + begin;
    batch.ids = query.ids;
    batch.distances = query.distances;
    run_all(n, [&](uint64_t a, uint64_t b) { kernels.list(batch, a, b); });
  });
  check_capacity(query, total);
}

std::shared_ptr<const HostNodeLists> CpuPhotonMap::lists_for(float radius) const
{
  const std::lock_guard lock(lists_mutex_);
  if (!lists_ || lists_->radius != radius) {
    lists_.reset();
    const PhotonGrid &grid = levels_.grids[0];
    lists_ =
        std::make_shared<HostNodeLists>(build_node_lists(grid.probes, grid.num_photons, radius, memory_));
  }
  return lists_;
}

void CpuPhotonMap::gather_from_node_lists(const PhotonQuery &query) const
{
  const std::shared_ptr<const HostNodeLists> lists = lists_for(query.range.radius);
  ListGather gather = {
      levels_.grids[0], lists->view(), query.range, query.positions, query.normals, query.counts,
      query.sums,       nullptr,       0,           nullptr,         nullptr};
  const uint64_t n = query.num_queries;
  const auto answer_all = [&] {
    run_all(n, [&](uint64_t a, uint64_t b) {
      for (uint64_t i = a; i < b; ++i) answer_from_lists(gather, i);
    });
  };
  if (query.kind != PhotonQueryKind::List) return answer_all();
  const TrackedArray<uint32_t> counts(memory_, n, "a batch of queries");
  gather.counts = const_cast<uint32_t *>(counts.data());
  answer_all();
  query.offsets[0] = 0;
  for (uint64_t i = 0; i < n; ++i) query.offsets[i + 1] = counts[i];
  sum_up(query.offsets, n);
  const uint64_t total = query.offsets[n];
  if ((query.ids != nullptr || query.distances != nullptr) && total <= query.capacity) {
    gather.counts = nullptr;
    gather.offsets = query.offsets;
    gather.ids = query.ids;
    gather.distances = query.distances;
    answer_all();
  }
  check_capacity(query, total);
}

void CpuPhotonMap::find_nearest(const PhotonQuery &query) const
{
  const GatherKernels &kernels = gather_kernels();
  const uint32_t k = query.k, capacity = std::max(4 * k, 256u);
  for (uint64_t begin = 0; begin < query.num_queries; begin += queries_per_slice) {
    const uint64_t end = std::min(begin + queries_per_slice, query.num_queries);
    const QueryOrder order(levels_.grids[0], query, begin, end, memory_);
    run_all(end - begin, [&](uint64_t a, uint64_t b) {
      std::vector<uint64_t> keys(capacity);
      for (uint64_t i = a; i < b; ++i) {
        const uint64_t index = begin + order.data()[i];
        const Vec3f p = query.positions[index];
        NearestSearch search = begin_nearest(levels_, p, k, query.limit, query.hint);
        uint32_t num;
        do {
          const PhotonGrid &grid = levels_.grids[level_for(levels_, search.radius)];
          num = kernels.collect(grid, p, search.radius, k, keys.data(), capacity, shrink);
        } while (num < k && grow(levels_, p, search, num, k));
        const uint32_t found = std::min(num, k);
        std::partial_sort(keys.begin(), keys.begin() + found, keys.begin() + num);
        for (uint32_t j = 0; j < k; ++j) {
          if (query.ids != nullptr) query.ids[index * k + j] = j < found ? uint32_t(keys[j]) : invalid_id;
          if (query.distances != nullptr)
            query.distances[index * k + j] = j < found ? sqrt(key_distance2(keys[j])) : infinity;
        }
        if (query.counts != nullptr) query.counts[index] = found;
      }
    });
  }
}

void CpuPhotonMap::read(Photon *records) const
{
  const PhotonGrid &grid = levels_.grids[0];
  arena_->execute([&] {
    tbb::parallel_for(
        tbb::blocked_range<uint64_t>(0, grid.num_photons, points_per_block), [&](const auto &range) {
          for (uint64_t i = range.begin(); i < range.end(); ++i) {
            const PhotonProbe &probe = grid.probes[i];
            const uint32_t id = photon_id(grid, uint32_t(i), probe);
            const PhotonRest rest = grid.rests != nullptr ? grid.rests[i] : PhotonRest{0, 0};
            records[id] = {
                probe.position, facts_.has_fluxes ? probe.flux : 0u, rest.direction, rest.normal, id, 0};
          }
        });
  });
}

}  // namespace gpurt
