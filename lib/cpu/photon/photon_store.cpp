#include "cpu/photon/photon_store.h"

#include "steady_seconds.h"

#include <tbb/parallel_for.h>

namespace gpurt {
namespace {

// Photons that run through the stages together.
constexpr uint32_t photons_per_chunk = 1024;

// What a photon takes while its grid is built: its record twice, the sort's two pairs, probe, rest and table entries.
constexpr uint64_t bytes_per_photon =
    2 * sizeof(Photon) + 2 * 8 + sizeof(PhotonProbe) + sizeof(PhotonRest) + 10;

}  // namespace

// One thread's memory for a wave of photons and what they leave behind.
struct PhotonStore::Scratch {
  explicit Scratch(uint32_t max_depth)
      : states(photons_per_chunk),
        rays(photons_per_chunk),
        next_rays(photons_per_chunk),
        hits(photons_per_chunk),
        ids(2 * size_t(photons_per_chunk)),
        slots(photons_per_chunk),
        left(photons_per_chunk * size_t(max_depth))
  {}
  static uint64_t bytes(uint32_t max_depth)
  {
    return photons_per_chunk * (sizeof(PhotonState) + 2 * (sizeof(Ray) + sizeof(uint32_t)) + sizeof(Hit) +
                                sizeof(Photon) * (1 + uint64_t(max_depth)));
  }
  PhotonWave wave()
  {
    return {states.data(),
            {rays.data(), ids.data()},
            hits.data(),
            {next_rays.data(), ids.data() + photons_per_chunk},
            slots.data()};
  }

  std::vector<PhotonState> states;
  std::vector<Ray> rays, next_rays;
  std::vector<Hit> hits;
  std::vector<uint32_t> ids;
  std::vector<Photon> slots, left;
  PhotonKernelCounters counters{};
};

PhotonStore::PhotonStore(const RenderPass &pass, const PhotonPass &photon_pass, const CpuPhotonScene &scene)
    : pass_(pass), photon_pass_(photon_pass), scene_(scene)
{
  const uint32_t max_depth = pass.settings.max_depth;
  scratch_bytes_ = Reservation(
      scene.memory, uint64_t(scene.arena.max_concurrency()) * Scratch::bytes(max_depth), "tracing photons");
  scratches_ =
      std::make_unique<tbb::enumerable_thread_specific<Scratch>>([max_depth] { return Scratch(max_depth); });
  counters_.smallest_radius = double(photon_pass.radius);
}

PhotonStore::~PhotonStore() = default;

bool PhotonStore::is_cancelled() const
{
  return pass_.cancelled != nullptr && pass_.cancelled->load(std::memory_order_relaxed);
}

// Photons that a map may hold: half of what the limit leaves, the rest being others'.
uint64_t PhotonStore::capacity() const
{
  const uint64_t limit = scene_.memory ? scene_.memory->limit() : 0;
  if (limit == 0) return max_photons;
  const uint64_t used = scene_.memory->used();
  return std::min<uint64_t>(max_photons, limit > used ? (limit - used) / 2 / bytes_per_photon : 0);
}

PhotonStore::Chunk PhotonStore::make_chunk(const PhotonChunk &traced) const
{
  Chunk chunk(scene_.memory, traced.num, "photons");
  std::copy_n(traced.photons, traced.num, chunk.data());
  return chunk;
}

// The next chunks, at most so many. Where the pass is cancelled some are empty.
std::vector<PhotonStore::Chunk> PhotonStore::trace_chunks(uint32_t most_chunks)
{
  const uint64_t left = photon_pass_.num_emitted - next_;
  const uint32_t num_chunks =
      uint32_t(std::min<uint64_t>((left + photons_per_chunk - 1) / photons_per_chunk, most_chunks));
  std::vector<Chunk> chunks(num_chunks);
  tbb::parallel_for(
      tbb::blocked_range<uint32_t>(0, num_chunks, 1),
      [&](const auto &range) {
        Scratch &scratch = scratches_->local();
        for (uint32_t k = range.begin(); k != range.end() && !is_cancelled(); ++k) {
          const uint32_t first = next_ + k * photons_per_chunk;
          const PhotonUnit unit{pass_.settings.seed,
                                pass_.settings.frame_index,
                                pass_.settings.max_depth,
                                photon_pass_,
                                pass_.photon->settings.photons_per_pass,
                                first};
          PhotonChunk chunk{scratch.left.data(), 0};
          scene_.kernels.trace(scene_.accel, scene_.scene, pass_.photon->emission, unit, scratch.wave(),
                               std::min(photons_per_chunk, photon_pass_.num_emitted - first), chunk,
                               steady_seconds, scratch.counters);
          chunks[k] = make_chunk(chunk);
        }
      },
      tbb::simple_partitioner());
  next_ += uint32_t(std::min(left, uint64_t(num_chunks) * photons_per_chunk));
  return chunks;
}

bool PhotonStore::fill()
{
  grid_.reset();
  const uint64_t capacity = this->capacity();
  const bool is_limited = capacity < max_photons;
  std::vector<Chunk> chunks;
  uint64_t num_photons = 0, most = 0;
  do {
    uint64_t in_batch = 0;
    for (Chunk &chunk : is_limited ? trace_some() : trace_chunks(UINT32_MAX)) {
      in_batch += chunk.size();
      chunks.push_back(std::move(chunk));
    }
    if (is_cancelled()) return false;
    num_photons += in_batch;
    most = std::max(most, in_batch);
    if (num_photons > max_photons)
      fail(GPURT_ERROR_UNSUPPORTED, "a pass stored more than {} photons; emit fewer photons_per_pass",
           max_photons);
  } while (!is_last() && num_photons + 2 * most <= capacity);

  const double start = steady_seconds();
  {
    TrackedArray<Photon> records(scene_.memory, num_photons, "photons");
    uint64_t to = 0;
    for (Chunk &chunk : chunks) {
      std::copy_n(chunk.data(), chunk.size(), records.data() + to);
      to += chunk.size();
      chunk.free();
    }
    const PhotonSource source{records.data(), nullptr, nullptr, nullptr, num_photons};
    uint64_t first_bad;
    const Box bounds = photon_bounds(source, first_bad);
    PhotonGridOptions options;
    options.radius = photon_pass_.radius;
    grid_.emplace(source, bounds, options, scene_.memory);
  }
  counters_.build_seconds += steady_seconds() - start;
  counters_.num_stored += num_photons;
  ++counters_.num_sub_passes;
  if (is_last()) {
    counters_.num_emitted = photon_pass_.num_emitted;
    for (const Scratch &scratch : *scratches_) {
      counters_.num_rays += scratch.counters.num_photon_rays;
      counters_.trace_seconds += scratch.counters.photon_seconds;
      counters_.emit_seconds += scratch.counters.emit_seconds;
      counters_.scatter_seconds += scratch.counters.scatter_seconds;
    }
  }
  return true;
}

// Few at a time, so that what they leave can be foreseen.
std::vector<PhotonStore::Chunk> PhotonStore::trace_some()
{
  return trace_chunks(2 * uint32_t(scene_.arena.max_concurrency()));
}

}  // namespace gpurt
