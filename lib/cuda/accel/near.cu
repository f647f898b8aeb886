// The order of the kernels of a batch, a look at the order of its rays, and what is left over.
#include <algorithm>

#include "cuda/accel/near_lane.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

namespace {

// Refilling pays from here on: smaller batches end before threads run out of work.
constexpr uint32_t min_refill_rays = 1u << 18;
constexpr uint32_t header_words = 64;

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
    d[k] = load_ray(batch.rays, first + lane, true).direction;
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

template <TraceQuery Query, class Kind>
__global__ void __launch_bounds__(block_size, 8)
    finish_kernel(const __grid_constant__ TraceScene s, const __grid_constant__ NearBatch batch)
{
  const uint32_t thread = uint32_t(thread_item()), num_threads = gridDim.x * block_size;
  const uint32_t num_leftovers = *batch.num_leftovers;
  const bool is_complete = num_leftovers <= batch.leftover_capacity;
  const uint32_t n = is_complete ? num_leftovers : batch.leftover_capacity;
  for (uint32_t k = thread; k < n; k += num_threads) {
    const auto &leftover = leftovers_of<Kind>(batch)[k];
    uint32_t count = 0;
    for (const uint32_t reference : leftover.references) count += reference != no_candidate ? 1 : 0;
    finish_left_over<Query, Kind>(s, batch, leftover.ray, count != 0 ? count : max_candidates + 1,
                                  [&](uint32_t c) {
                                    uint32_t placement = invalid_id;
                                    if constexpr (Kind::placements) placement = leftover.placements[c];
                                    return Candidate{leftover.references[c], placement};
                                  });
  }
  if (is_complete) return;
  for (uint32_t i = thread; i < batch.num_rays; i += num_threads) {
    bool is_unlisted;
    if constexpr (Query == TraceQuery::Any)
      is_unlisted = static_cast<const uint8_t *>(batch.results)[i] == unlisted_result;
    else is_unlisted = batch.candidates[i] == unlisted_left_over;
    if (is_unlisted)
      finish_left_over<Query, Kind>(s, batch, i, max_candidates + 1,
                                    [](uint32_t) { return Candidate{0, invalid_id}; });
  }
}

// Measures what rays of warps that refill found, all lanes of a warp at once: amid traversal few rays end at a time, and its registers
// would be in the way.
template <class Kind>
__global__ void __launch_bounds__(block_size, 8)
    measure_kernel(const __grid_constant__ TraceScene s, const __grid_constant__ NearBatch batch)
{
  if (!is_for(batch, Coherence::Incoherent)) return;
  const uint32_t i = uint32_t(thread_item());
  if (i >= batch.num_rays) return;
  const uint32_t candidate = batch.candidates[i];
  if (candidate == left_over || candidate == unlisted_left_over) return;
  const uint32_t placement = Kind::placements ? waiting_placement(batch, i) : invalid_id;
  if (measure_one<Kind>(s, batch, i, {candidate, placement})) return;
  uint32_t references[pending_words<Kind>];
  references[0] = candidate | unclear_bit;
  if constexpr (Kind::placements) references[pending_capacity] = placement;
  finish_in_place<Kind>(s, batch, i, 1, references);
}

// How the words of a batch's scratch memory are shared out.
struct ScratchLayout {
  explicit ScratchLayout(uint64_t num_rays)
      : leftover_capacity(num_rays / 8 + 32),
        leftovers(header_words + num_rays),
        end(leftovers + leftover_capacity * (sizeof(Leftover) / sizeof(uint32_t)))
  {}
  uint64_t leftover_capacity;
  uint64_t leftovers, end;
};

NearBatch make_batch(const TraceScene &scene, const Ray *rays, uint32_t num_rays, HitLayout layout,
                     void *results, const RayOrder &order)
{
  const ScratchLayout layout_of(num_rays);
  NearBatch batch{};
  batch.rays = rays;
  batch.num_rays = num_rays;
  batch.layout = layout;
  batch.results = results;
  batch.left_out = order.left_out;
  batch.ended_at = order.ended_at;
  batch.next_ray = order.scratch;
  batch.num_leftovers = order.scratch + 1;
  batch.candidates = order.scratch + header_words;
  batch.leftovers = reinterpret_cast<Leftover *>(order.scratch + layout_of.leftovers);
  batch.leftover_capacity = uint32_t(layout_of.leftover_capacity);
  if (scene.scene.num_placements != 0) {
    batch.leftover_capacity =
        uint32_t(layout_of.leftover_capacity * sizeof(Leftover) / sizeof(PlacedLeftover));
  }
  return batch;
}

constexpr uint64_t num_cleared_words = 2;
void clear_counters(const RayOrder &order, cudaStream_t stream)
{
  check(cudaMemsetAsync(order.scratch, 0, num_cleared_words * sizeof(uint32_t), stream), "cudaMemsetAsync");
}

void launch_near_refill(const TraceScene &scene, TraceQuery query, const NearBatch &batch,
                        cudaStream_t stream)
{
  (scene.has_bvhs ? launch_bvh_refill : launch_quad_refill)(scene, query, batch, stream);
  if (query != TraceQuery::Closest) return;
  dispatch_near(scene, [&]<class Kind>(Kind) {
    launch("kernel that measures hits", measure_kernel<Kind>, batch.num_rays, stream, scene, batch);
  });
}

// What a batch is traced as; Auto: as its rays turn out to lie.
//
// Closest hits of warps that refill are measured by a kernel of its own, which takes some 50 us of 2^21 rays on an H100. What
// refilling saves makes up for it where steps wait for memory. Of bvhs that stay in the cache it does not always: 4433 against
// 4981 Mrays/s (city, diffuse rays), 11542 against 14898 (bunny, random), but 4839 against 4581 (city, random), 5575 against
// 5033 (bunny, diffuse). Among placements it does: 1027 against 756 (rocks of bench_rays, random), 2655 against 2776 (diffuse).
Coherence order_of(const TraceScene &scene, TraceQuery query, uint32_t num_rays, Coherence hint)
{
  if (num_rays < min_refill_rays) return Coherence::Coherent;
  const bool hardly_waits =
      query == TraceQuery::Closest && scene.has_bvhs && scene.is_cached && scene.scene.num_placements == 0;
  return hint == Coherence::Auto && hardly_waits ? Coherence::Coherent : hint;
}

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
  dispatch_near(scene, [&]<class Kind>(Kind) {
    launch(is_any ? "kernel that finishes any hits" : "kernel that finishes closest hits",
           is_any ? finish_kernel<TraceQuery::Any, Kind> : finish_kernel<TraceQuery::Closest, Kind>,
           num_threads, stream, scene, batch);
  });
}

bool suits_near_kernels(const TraceScene &scene, const Ray *rays, HitLayout layout, const void *results,
                        const RayOrder &order)
{
  return order.scratch != nullptr && has_near_kernels(scene) && is_aligned_16(rays) &&
         (layout == HitLayout::Internal || is_aligned_16(results));
}

void launch_near(const TraceScene &scene, TraceQuery query, const Ray *rays, uint32_t num_rays,
                 HitLayout layout, void *results, const RayOrder &order, cudaStream_t stream)
{
  if (num_rays == 0) return;
  NearBatch batch = make_batch(scene, rays, num_rays, layout, results, order);
  if (!has_near_refill(scene)) return launch_bvh_masked(scene, query, batch, order.width, stream);
  const Coherence coherence = order_of(scene, query, num_rays, order.coherence);
  // Closest hits by a thread a ray leave nothing over.
  const bool has_leftovers = query == TraceQuery::Any || coherence != Coherence::Coherent;
  if (has_leftovers) clear_counters(order, stream);
  if (coherence == Coherence::Auto) {
    uint32_t *const probed = order.scratch + num_cleared_words;
    launch_near_probe(batch, probed, stream);
    batch.probed = probed;
  }
  // Where the kernels look at what was found, those for the other order end at once.
  if (coherence != Coherence::Incoherent)
    (scene.has_bvhs ? launch_bvh_plain : launch_quad_plain)(scene, query, batch, order.width, stream);
  if (coherence != Coherence::Coherent) launch_near_refill(scene, query, batch, stream);
  if (has_leftovers) launch_near_finish(scene, query, batch, stream);
}

void launch_near_persistent(const TraceScene &scene, TraceQuery query, const Ray *rays, uint32_t num_rays,
                            HitLayout layout, void *results, const RayOrder &order,
                            unsigned long long *num_refills, cudaStream_t stream)
{
  if (num_rays == 0) return;
  NearBatch batch = make_batch(scene, rays, num_rays, layout, results, order);
  batch.num_refills = num_refills;
  clear_counters(order, stream);
  launch_near_refill(scene, query, batch, stream);
  launch_near_finish(scene, query, batch, stream);
}

GPURT_KERNELS_END
}  // namespace gpurt::cuda
