#include "cpu/committed_scene.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>

#include "accel/isa.h"
#include "core/accel/hit_ids.h"
#include "cpu/kernels.h"
#include "cpu/path/render.h"
#include "cpu/photon/scene_photons.h"
#include "cpu/reyes/render.h"
#include "cpu/reyes/wide_kernel.h"

namespace gpurt {
namespace {

static_assert(sizeof(Ray) == sizeof(gpurt_ray) && offsetof(Ray, direction) == offsetof(gpurt_ray, direction));
static_assert(sizeof(FullHit) == sizeof(gpurt_hit) &&
              offsetof(FullHit, instance) == offsetof(gpurt_hit, instance));
static_assert(sizeof(CompactHit) == sizeof(gpurt_hit_compact));

// Rays that a thread takes at a time: enough to make the scheduler's work small, few enough to share out.
constexpr uint64_t rays_per_block = 1024;
// Hits in their internal form, on the stack.
constexpr uint32_t rays_per_call = 128;
// All hits: about this many are held between finding and writing them.
constexpr uint64_t hits_per_slice = 1u << 20;

struct BlockOfHits {
  std::vector<Hit> hits;
  Reservation reservation;
};

void append(void *user, const Hit &hit) { static_cast<std::vector<Hit> *>(user)->push_back(hit); }

}  // namespace

CpuScene::CpuScene(std::shared_ptr<const CompiledScene> scene, std::unique_ptr<Accelerator> accelerator,
                   std::shared_ptr<tbb::task_arena> arena, std::shared_ptr<MemoryTracker> memory)
    : scene_(std::move(scene)),
      view_(scene_->view()),
      accelerator_(std::move(accelerator)),
      arena_(std::move(arena)),
      memory_(std::move(memory))
{
  view_.t_error = t_error(accelerator_->facts());
}

void CpuScene::render(const RenderPass &pass) const
{
  if (pass.photon) {
    render_photons_on_cpu(pass, {accel(), view_, photon_kernels(cpu_kernels().isa), *arena_, memory_});
    return;
  }
  if (pass.reyes != nullptr) {
    ReyesScene reyes = scene_->reyes_view();
    reyes.scene = view_;
    const char *const isa = wide_isa_name();
    render_reyes_on_cpu(pass, accel(), reyes, reyes_kernels(isa), wide_kernels(isa), *arena_, memory_);
    return;
  }
  render_on_cpu(pass, accel(), view_, path_kernel(cpu_kernels().isa), *arena_, memory_);
}

PhotonPilot CpuScene::photon_pilot(const PathSettings &settings, const EmissionView &emission,
                                   uint32_t num_paths, uint32_t points_per_axis,
                                   const TakePilotPhotons &take) const
{
  return photon_pilot_on_cpu(settings, emission, num_paths, points_per_axis, take,
                             {accel(), view_, photon_kernels(cpu_kernels().isa), *arena_, memory_});
}

std::shared_ptr<const PhotonMap> CpuScene::photon_map(const PathSettings &settings,
                                                      const EmissionView &emission,
                                                      const ScenePhotonRequest &request) const
{
  return photon_map_on_cpu(settings, emission, request,
                           {accel(), view_, photon_kernels(cpu_kernels().isa), *arena_, memory_}, arena_);
}

void CpuScene::trace(const TraceRequest &request) const
{
  arena_->execute([&] {
    switch (request.query) {
      case QueryKind::Closest:
        trace_closest_hits(request);
        break;
      case QueryKind::Any:
        trace_any_hits(request);
        break;
      case QueryKind::All:
        trace_all_hits(request);
        break;
    }
  });
}

void CpuScene::write_hits(const TraceRequest &request, uint64_t first, const Hit *hits, uint64_t n) const
{
  if (request.compact) {
    auto *out = static_cast<CompactHit *>(request.hits) + first;
    for (uint64_t i = 0; i < n; ++i) out[i] = compact_hit(view_, hits[i]);
  } else {
    auto *out = static_cast<FullHit *>(request.hits) + first;
    for (uint64_t i = 0; i < n; ++i) out[i] = full_hit(view_, hits[i]);
  }
}

void CpuScene::trace_closest_hits(const TraceRequest &request) const
{
  const CpuAccel &queries = accel();
  tbb::parallel_for(tbb::blocked_range<uint64_t>(0, request.num_rays, rays_per_block),
                    [&](const auto &range) {
                      Hit hits[rays_per_call];
                      for (uint64_t i = range.begin(); i < range.end(); i += rays_per_call) {
                        const uint32_t n = uint32_t(std::min<uint64_t>(rays_per_call, range.end() - i));
                        queries.closest(queries, request.rays + i, hits, n);
                        write_hits(request, i, hits, n);
                      }
                    });
}

void CpuScene::trace_any_hits(const TraceRequest &request) const
{
  const CpuAccel &queries = accel();
  tbb::parallel_for(tbb::blocked_range<uint64_t>(0, request.num_rays, rays_per_block),
                    [&](const auto &range) {
                      for (uint64_t i = range.begin(); i < range.end(); i += rays_per_block) {
                        const uint32_t n = uint32_t(std::min<uint64_t>(rays_per_block, range.end() - i));
                        queries.occluded(queries, request.rays + i, request.occluded + i, n);
                      }
                    });
}

// Slices of rays, each found by all threads and then written behind the slice before. A slice's size follows from the
// hits that rays had so far, so that memory stays bounded whatever there is to hit.
void CpuScene::trace_all_hits(const TraceRequest &request) const
{
  constexpr uint64_t block_size = 64;
  const auto precedes = [&](const Hit &a, const Hit &b) { return hit_precedes(view_, a, b); };
  const auto same = [](const Hit &a, const Hit &b) {
    return a.triangle == b.triangle && a.placement == b.placement;
  };
  uint64_t total = 0, slice = 4 * block_size;
  request.offsets[0] = 0;
  for (uint64_t first = 0; first < request.num_rays;) {
    const uint64_t n = std::min(slice, request.num_rays - first);
    const uint64_t num_blocks = (n + block_size - 1) / block_size;
    const bool keeps_hits = request.hits != nullptr && total <= request.hit_capacity;
    std::vector<BlockOfHits> blocks(num_blocks);
    tbb::parallel_for(uint64_t(0), num_blocks, [&](uint64_t b) {
      std::vector<Hit> found;
      const uint64_t begin = first + b * block_size, end = std::min(begin + block_size, first + n);
      for (uint64_t i = begin; i < end; ++i) {
        found.clear();
        accelerator_->all(request.rays[i], &found, append);
        std::sort(found.begin(), found.end(), precedes);
        found.erase(std::unique(found.begin(), found.end(), same), found.end());
        request.offsets[i + 1] = found.size();
        if (keeps_hits) blocks[b].hits.insert(blocks[b].hits.end(), found.begin(), found.end());
      }
      blocks[b].reservation =
          Reservation(memory_, blocks[b].hits.capacity() * sizeof(Hit), "a batch of hits");
    });
    for (uint64_t i = first; i < first + n; ++i) {
      total += request.offsets[i + 1];
      request.offsets[i + 1] = total;
    }
    if (keeps_hits && total <= request.hit_capacity) {
      tbb::parallel_for(uint64_t(0), num_blocks, [&](uint64_t b) {
        write_hits(request, request.offsets[first + b * block_size], blocks[b].hits.data(),
                   blocks[b].hits.size());
      });
    }
    first += n;
    const double hits_per_ray = std::max(1.0, double(total) / double(first));
    slice =
        std::clamp<uint64_t>(uint64_t(double(hits_per_slice) / hits_per_ray), block_size, 1024 * block_size);
  }
  if (request.hits != nullptr && total > request.hit_capacity) {
    fail_invalid("the rays have {} hits, but hit_capacity is {}; make hits larger, offsets tell how large",
                 total, request.hit_capacity);
  }
}

}  // namespace gpurt
