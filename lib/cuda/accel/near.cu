// What the bvh's fast kernels leave to do, to measure hits in double above all, and the order of the kernels of a batch.
#include <algorithm>

#include "cuda/accel/near_lane.h"

namespace gpurt::cuda {
namespace {

// Refilling pays from here on: smaller batches end before threads run out of work.
constexpr uint32_t min_refill_rays = 1u << 18;
constexpr uint32_t header_words = 64;

// The general way.
template <TraceQuery Query, bool Bvh>
__device__ __noinline__ void trace_general(const TraceScene &s, const NearBatch &batch, uint32_t i)
{
  const auto &accel = [&]() -> const auto & {
    if constexpr (Bvh) return s.bvhs;
    else return s.kd_trees;
  }();
  const Ray ray = load_ray(batch.rays, i, batch.aligned_rays);
  if constexpr (Query == TraceQuery::Any) {
    static_cast<uint8_t *>(batch.results)[i] =
        trace_any<TriangleTest::Watertight, false, false>(accel, s.scene, ray) ? 1 : 0;
  } else {
    const Hit hit = trace_closest<TriangleTest::Watertight, false, false>(accel, s.scene, ray);
    store_closest(s, batch, i, hit,
                  hit.triangle == invalid_id ? invalid_id : primitive_of(s.scene, hit.triangle));
  }
}

// Measures the candidates of a ray and writes its hit, the nearest of them.
template <TraceQuery Query, bool Bvh, class Reference>
__device__ __forceinline__ void measure_candidates(const TraceScene &s, const NearBatch &batch, uint32_t i,
                                                   uint32_t count, Reference &&reference)
{
  const Ray ray = load_ray(batch.rays, i, batch.aligned_rays);
  Hit best = {ray.tmax, 0.0f, 0.0f, invalid_id, invalid_id};
  uint32_t primitive = invalid_id;
  bool is_clear = true;
  for (uint32_t c = 0; c < count; ++c) {
    const uint32_t candidate = reference(c);
    if (candidate == no_candidate) break;
    const LeafTriangle x = load_triangle(s.near_triangles, candidate);
    TriangleHit hit;
    if (!measure(s, x, ray, hit, is_clear)) continue;
    if (best.triangle != invalid_id && (hit.t > best.t || (hit.t == best.t && x.triangle > best.triangle)))
      continue;
    best = {hit.t, hit.u, hit.v, x.triangle, invalid_id};
    primitive = x.primitive;
  }
  if (!is_clear) trace_general<Query, Bvh>(s, batch, i);
  else if (Query == TraceQuery::Any)
    static_cast<uint8_t *>(batch.results)[i] = best.triangle != invalid_id ? 1 : 0;
  else store_closest(s, batch, i, best, primitive);
}

// A block looks at groups of 32 rays, a warp at two, spread evenly over the batch: they are coherent if most groups go
// within 18 degrees of their first ray.
constexpr unsigned probe_threads = 1024, groups_per_warp = 2;
__global__ void __launch_bounds__(probe_threads)
    probe_kernel(const __grid_constant__ NearBatch batch, uint32_t *probed)
{
  constexpr unsigned num_groups = probe_threads / 32 * groups_per_warp;
  const unsigned lane = threadIdx.x % 32, group = threadIdx.x / 32 * groups_per_warp;
  Vec3f d[groups_per_warp];
  for (unsigned k = 0; k < groups_per_warp; ++k) {
    const uint32_t first = uint32_t(uint64_t(batch.num_rays / 32) * (group + k) / num_groups) * 32;
    d[k] = load_ray(batch.rays, first + lane, batch.aligned_rays).direction;
  }
  int num_coherent = 0;
  for (unsigned k = 0; k < groups_per_warp; ++k) {
    const Vec3f first_d{__shfl_sync(~0u, d[k].x, 0), __shfl_sync(~0u, d[k].y, 0),
                        __shfl_sync(~0u, d[k].z, 0)};
    const float along = dot(d[k], first_d);
    const bool is_near = along > 0.0f && along * along > 0.9f * dot(d[k], d[k]) * dot(first_d, first_d);
    num_coherent += __syncthreads_count(__all_sync(~0u, is_near) && lane == 0);
  }
  if (threadIdx.x == 0)
    *probed = uint32_t(2 * num_coherent > int(num_groups) ? Coherence::Coherent : Coherence::Incoherent);
}

template <TraceQuery Query, bool Bvh>
__global__ void __launch_bounds__(block_size, 8)
    finish_kernel(const __grid_constant__ TraceScene s, const __grid_constant__ NearBatch batch)
{
  const uint32_t thread = uint32_t(thread_item()), num_threads = gridDim.x * block_size;
  const uint32_t num_groups = min(*batch.num_groups, batch.group_capacity);
  for (uint32_t k = thread; k < num_groups; k += num_threads) {
    const CandidateGroup &group = batch.groups[k];
    measure_candidates<Query, Bvh>(s, batch, group.ray, max_candidates,
                                   [&](uint32_t c) { return group.references[c]; });
  }
  const uint32_t num_listed = *batch.num_listed;
  const bool is_complete = num_listed <= batch.list_capacity;
  const uint32_t n = is_complete ? num_listed : batch.num_rays;
  for (uint32_t k = thread; k < n; k += num_threads)
    trace_general<Query, Bvh>(s, batch, is_complete ? batch.listed[k] : k);
}

// How the words of a batch's scratch memory are shared out.
struct ScratchLayout {
  explicit ScratchLayout(uint64_t num_rays)
      : group_capacity(num_rays / 16 + 32),
        list_capacity(num_rays / 16 + 32),
        taken_before(header_words + num_rays),
        groups(taken_before + num_rays / 32 + 1),
        listed(groups + group_capacity * (sizeof(CandidateGroup) / sizeof(uint32_t))),
        end(listed + list_capacity)
  {}
  uint64_t group_capacity, list_capacity;
  uint64_t taken_before, groups, listed, end;
};

}  // namespace

uint64_t trace_scratch_words(uint64_t num_rays) { return ScratchLayout(num_rays).end; }

void launch_near_probe(const NearBatch &batch, uint32_t *probed, cudaStream_t stream)
{
  launch_blocks("kernel that looks at the order of rays", probe_kernel, 1, probe_threads, stream, batch,
                probed);
}

void launch_near_finish(const TraceScene &scene, TraceQuery query, const NearBatch &batch,
                        cudaStream_t stream)
{
  const uint64_t num_threads = std::min<uint64_t>(batch.num_rays, uint64_t(scene.num_sms) * 8 * block_size);
  const bool is_any = query == TraceQuery::Any;
  const auto kernel =
      scene.has_bvhs
          ? (is_any ? finish_kernel<TraceQuery::Any, true> : finish_kernel<TraceQuery::Closest, true>)
          : (is_any ? finish_kernel<TraceQuery::Any, false> : finish_kernel<TraceQuery::Closest, false>);
  launch(is_any ? "kernel that finishes any hits" : "kernel that finishes closest hits", kernel, num_threads,
         stream, scene, batch);
}

void launch_near(const TraceScene &scene, TraceQuery query, const Ray *rays, uint32_t num_rays,
                 HitLayout layout, void *results, const RayOrder &order, cudaStream_t stream)
{
  if (num_rays == 0) return;
  const ScratchLayout layout_of(num_rays);
  NearBatch batch{};
  batch.rays = rays;
  batch.num_rays = num_rays;
  batch.layout = layout;
  batch.results = results;
  batch.aligned_rays = is_aligned_16(rays);
  batch.aligned_results = is_aligned_16(results);
  batch.left_out = order.left_out;
  batch.ended_at = order.ended_at;
  batch.next_ray = order.scratch;
  batch.num_groups = order.scratch + 1;
  batch.num_listed = order.scratch + 2;
  batch.candidates = order.scratch + header_words;
  batch.taken_before = order.scratch + layout_of.taken_before;
  batch.groups = reinterpret_cast<CandidateGroup *>(order.scratch + layout_of.groups);
  batch.listed = order.scratch + layout_of.listed;
  batch.group_capacity = uint32_t(layout_of.group_capacity);
  batch.list_capacity = uint32_t(layout_of.list_capacity);
  check(cudaMemsetAsync(order.scratch, 0, header_words * sizeof(uint32_t), stream), "cudaMemsetAsync");
  Coherence coherence = num_rays < min_refill_rays ? Coherence::Coherent : order.coherence;
  // In a kd-tree refilling pays for rays alone that start apart as well, which a look at directions does not tell.
  if (coherence == Coherence::Auto && !scene.has_bvhs) coherence = Coherence::Coherent;
  if (coherence == Coherence::Auto) {
    uint32_t *const probed = order.scratch + 3;
    launch_near_probe(batch, probed, stream);
    batch.probed = probed;
  }
  // Where the kernels look at what was found, those for the other order end at once.
  if (coherence != Coherence::Incoherent)
    (scene.has_bvhs ? launch_near_plain : launch_near_kd_plain)(scene, query, batch, order.width, stream);
  if (coherence != Coherence::Coherent) {
    (scene.has_bvhs ? launch_near_refill : launch_near_kd_refill)(scene, query, batch, stream);
  }
  launch_near_finish(scene, query, batch, stream);
}

}  // namespace gpurt::cuda
