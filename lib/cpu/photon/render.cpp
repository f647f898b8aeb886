#include "cpu/photon/render.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <cstring>
#include <map>

#include "cpu/path/render_counters.h"
#include "cpu/path/wave_scratch.h"
#include "cpu/photon/photon_store.h"

namespace gpurt {
namespace {

// One thread's memory for eye paths, the film of their unit and what they gather.
struct EyeScratch {
  EyeScratch() : points(wave_capacity), sums(wave_capacity), blurs(wave_capacity) {}
  static constexpr uint64_t bytes()
  {
    return WaveScratch::bytes() +
           uint64_t(wave_capacity) * (sizeof(VisiblePoint) + sizeof(PhotonSum) + sizeof(PhotonBlur));
  }
  WaveScratch wave;
  std::vector<VisiblePoint> points;
  std::vector<PhotonSum> sums;
  std::vector<PhotonBlur> blurs;
};

uint64_t area(const WorkUnit &u) { return uint64_t(u.x1 - u.x0) * (u.y1 - u.y0); }

uint64_t largest_area(std::span<const WorkUnit> units)
{
  uint64_t largest = 0;
  for (const WorkUnit &u : units) largest = std::max(largest, area(u));
  return largest;
}

RenderCounters counters_from(const PhotonKernelCounters &kernel, uint64_t num_samples)
{
  RenderCounters c = counters_from(kernel.path, num_samples);
  c.photon.num_gathered = kernel.num_gathered;
  c.photon.num_visible = kernel.num_visible;
  c.photon.gather_seconds = kernel.gather_seconds;
  return c;
}

// What the pixels of a unit gathered, while further maps of the pass are to come.
struct KeptSums {
  std::vector<PhotonSum> sums;
  std::vector<PhotonBlur> blurs;  // empty where they are not wanted
};

// The units of one sample index, with the photons of that pass.
class PassRenderer {
 public:
  PassRenderer(const RenderPass &pass, const CpuPhotonScene &scene, std::vector<WorkUnit> units,
               tbb::enumerable_thread_specific<EyeScratch> &scratches)
      : pass_(pass),
        scene_(scene),
        units_(std::move(units)),
        scratches_(scratches),
        photon_pass_(make_photon_pass(pass.photon->settings, pass.photon->emission, units_[0].first_sample)),
        has_blurs_(wants_blur(photon_pass_, TileFilm::has_errors(pass.outputs)))
  {}

  void run()
  {
    PhotonStore store(pass_, photon_pass_, scene_);
    std::vector<KeptSums> kept;  // of the units
    Reservation kept_bytes;
    bool is_first = true;
    do {
      if (!store.fill()) return;
      if (is_first && !store.is_last()) {
        uint64_t num_pixels = 0;
        for (const WorkUnit &u : units_) num_pixels += area(u);
        const uint64_t bytes = sizeof(PhotonSum) + (has_blurs_ ? sizeof(PhotonBlur) : 0);
        kept_bytes = Reservation(scene_.memory, num_pixels * bytes, "sums of photons");
        for (const WorkUnit &u : units_) {
          kept.emplace_back(std::vector<PhotonSum>(area(u), no_photons),
                            std::vector<PhotonBlur>(has_blurs_ ? area(u) : 0, no_blur));
        }
      }
      gather(store, kept);
      is_first = false;
    } while (!store.is_last() && !is_cancelled());
  }

 private:
  bool is_cancelled() const
  {
    return pass_.cancelled != nullptr && pass_.cancelled->load(std::memory_order_relaxed);
  }

  static constexpr PhotonSum no_photons{{0, 0, 0}, 0, 0};
  static constexpr PhotonBlur no_blur{{0, 0, 0}};

  void gather(PhotonStore &store, std::vector<KeptSums> &kept)
  {
    const PhotonGrid grid = store.grid();
    std::atomic<bool> is_counted{false};
    tbb::parallel_for(
        tbb::blocked_range<size_t>(0, units_.size(), 1),
        [&](const tbb::blocked_range<size_t> &range) {
          EyeScratch &scratch = scratches_.local();
          for (size_t k = range.begin(); k != range.end(); ++k) {
            PhotonKernelCounters counters{};
            if (!gather_unit(units_[k], grid, store.is_last(), kept.empty() ? nullptr : &kept[k], scratch,
                             counters))
              return;
            if (!store.is_last()) continue;
            RenderCounters c = counters_from(counters, area(units_[k]));
            // What the whole pass took goes with one of its units.
            if (!is_counted.exchange(true)) c.photon.add(store.counters());
            pass_.deliver(units_[k], scratch.wave.film, c);
          }
        },
        tbb::simple_partitioner());
  }

  bool gather_unit(const WorkUnit &unit, const PhotonGrid &grid, bool is_last, KeptSums *kept,
                   EyeScratch &scratch, PhotonKernelCounters &counters)
  {
    const PathWave wave = scratch.wave.wave();
    const uint32_t width = unit.x1 - unit.x0, height = unit.y1 - unit.y0;
    if (is_last) {
      scratch.wave.film.reset(width, height, pass_.outputs);
      copy_statistics(unit, scratch.wave.film);
    }
    const FilmView film =
        is_last ? scratch.wave.film.view() : FilmView{nullptr, nullptr, nullptr, width, height};
    const uint64_t num_paths = area(unit);
    for (uint64_t first = 0; first < num_paths; first += wave_capacity) {
      if (is_cancelled()) return false;
      const PathUnit part{unit.x0, unit.y0, unit.x1, unit.y1, unit.first_sample, first};
      const uint32_t n = uint32_t(std::min<uint64_t>(wave_capacity, num_paths - first));
      PhotonSums sums{scratch.sums.data(), has_blurs_ ? scratch.blurs.data() : nullptr};
      if (kept) {
        sums = {kept->sums.data() + first, has_blurs_ ? kept->blurs.data() + first : nullptr};
      } else {
        std::fill_n(sums.sums, n, no_photons);
        if (has_blurs_) std::fill_n(sums.blurs, n, no_blur);
      }
      scene_.kernels.gather(scene_.accel, scene_.scene, pass_.settings, photon_pass_, grid, part, wave, film,
                            pass_.statistics, scratch.points.data(), sums, n, steady_seconds, counters);
      if (is_last) {
        scene_.kernels.resolve(photon_pass_, part, wave, film, scratch.points.data(), sums, n, counters);
      }
    }
    return true;
  }

  // A unit's film starts with what its pixels have, and ends with what they have after the pass.
  void copy_statistics(const WorkUnit &unit, TileFilm &film) const
  {
    if (film.statistics.empty()) return;
    const uint64_t width = unit.x1 - unit.x0;
    for (uint32_t y = unit.y0; y < unit.y1; ++y) {
      std::copy_n(pass_.statistics + uint64_t(y) * pass_.settings.camera.width + unit.x0, width,
                  film.statistics.begin() + std::ptrdiff_t((y - unit.y0) * width));
    }
  }

  const RenderPass &pass_;
  const CpuPhotonScene &scene_;
  const std::vector<WorkUnit> units_;
  tbb::enumerable_thread_specific<EyeScratch> &scratches_;
  const PhotonPass photon_pass_;
  const bool has_blurs_;
};

}  // namespace

void render_photons_on_cpu(const RenderPass &pass, const CpuPhotonScene &scene)
{
  std::map<uint64_t, std::vector<WorkUnit>> by_sample;
  for (const WorkUnit &u : pass.units) {
    if (u.num_samples != 1)
      fail(GPURT_ERROR_INTERNAL, "a unit of photon mapping has {} samples", u.num_samples);
    by_sample[u.first_sample].push_back(u);
  }
  const uint64_t num_threads = uint64_t(scene.arena.max_concurrency());
  const Reservation reserved(
      scene.memory,
      num_threads * (EyeScratch::bytes() + TileFilm::bytes_for(largest_area(pass.units), pass.outputs)),
      "rendering's working memory");
  scene.arena.execute([&] {
    tbb::enumerable_thread_specific<EyeScratch> scratches;
    for (auto &[sample, units] : by_sample) PassRenderer(pass, scene, std::move(units), scratches).run();
  });
}

PhotonPilot photon_pilot_on_cpu(const PathSettings &settings, const EmissionView &emission,
                                uint32_t num_paths, uint32_t points_per_axis, const TakePilotPhotons &take,
                                const CpuPhotonScene &scene)
{
  PhotonPilot pilot;
  scene.arena.execute([&] {
    {
      const Reservation reserved(scene.memory, EyeScratch::bytes(), "a pilot's eye paths");
      EyeScratch scratch;
      const PathWave wave = scratch.wave.wave();
      const uint32_t width = settings.camera.width, height = settings.camera.height;
      for (uint32_t j = 0; j < points_per_axis; ++j) {
        for (uint32_t i = 0; i < points_per_axis; ++i) {
          const uint32_t x = uint32_t((2 * uint64_t(i) + 1) * width / (2 * points_per_axis));
          const uint32_t y = uint32_t((2 * uint64_t(j) + 1) * height / (2 * points_per_axis));
          scene.kernels.find_points(scene.accel, scene.scene, settings, {x, y, x + 1, y + 1, 0, 0}, wave,
                                    scratch.points.data(), 1, steady_seconds);
          const VisiblePoint &point = scratch.points[0];
          if (point.depth != 0) pilot.points.push_back({point.position, point.normal_code});
        }
      }
    }
    const PhotonRequest request{{num_paths, 1, PhotonKernel::Constant, 0}, emission};
    RenderPass pass;
    pass.settings = settings;
    pass.photon = &request;
    PhotonPass photon_pass = make_photon_pass(request.settings, emission, 0);
    photon_pass.index = pilot_pass;
    PhotonStore store(pass, photon_pass, scene);
    while (!store.is_last()) {
      for (const PhotonStore::Chunk &chunk : store.trace_some()) {
        take(pilot.points, {chunk.data(), chunk.size()});
        pilot.num_photons += chunk.size();
      }
    }
  });
  return pilot;
}

#if defined(__x86_64__)
inline namespace x86_64 {
const PhotonKernels &photon_kernels();
}
namespace x86_64_v3 {
const PhotonKernels &photon_kernels();
}
const PhotonKernels &photon_kernels(const char *isa_name)
{
  return std::strcmp(isa_name, "x86_64_v3") == 0 ? x86_64_v3::photon_kernels() : x86_64::photon_kernels();
}
#else
inline namespace generic {
const PhotonKernels &photon_kernels();
}
const PhotonKernels &photon_kernels(const char *) { return generic::photon_kernels(); }
#endif

}  // namespace gpurt
