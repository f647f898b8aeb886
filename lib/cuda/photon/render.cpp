#include "cuda/photon/render.h"

#include <algorithm>
#include <optional>
#include <set>
#include <utility>

#include "cuda/path/group_film.h"
#include "cuda/photon/eye_tracer.h"
#include "cuda/photon/photon_store.h"
#include "error.h"

namespace gpurt::cuda {
namespace {

// Photons and paths that run together. More no longer help the device; fewer are taken where memory is short.
constexpr uint32_t most_in_flight = uint32_t(1) << 20;
constexpr uint32_t fewest_in_flight = uint32_t(1) << 10;
// Pixels whose film is on the device at once: the photons of a pass are traced again for the others.
constexpr uint64_t most_pixels = uint64_t(1) << 25;

// The lights' shares in device memory.
class DeviceEmission {
 public:
  DeviceEmission(const EmissionView &emission, const std::shared_ptr<DeviceMemory> &memory,
                 cudaStream_t stream)
      : view_(emission)
  {
    if (emission.cdf == nullptr) return;
    cdf_ = upload(memory, std::span<const float>(emission.cdf, uint64_t(emission.num_sources) + 1),
                  "the lights' shares of photons", stream);
    view_.cdf = cdf_.data();
  }
  const EmissionView &view() const { return view_; }

 private:
  EmissionView view_;
  DeviceBuffer<float> cdf_;
};

// What passes work on.
struct Workspace {
  Workspace(PassQueue &queue, uint32_t num_flying, uint32_t num_paths, uint64_t num_pixels, uint32_t outputs)
      : film(queue.memory, GroupFilm(num_pixels, outputs).bytes(), "the film of passes"),
        sums(queue.memory, num_pixels, "sums of photons"),
        eye(queue, num_paths),
        store(queue, num_flying)
  {}
  DeviceBuffer<std::byte> film;
  DeviceBuffer<PhotonSum> sums;
  EyeTracer eye;
  PhotonStore store;  // last, since it looks at what the others leave
};

// Groups that are rendered together, and where their parts of film and sums lie.
struct Batch {
  struct Part {
    UnitGroup group;
    uint64_t first_pixel;
  };
  std::vector<Part> parts;
  uint64_t num_pixels = 0;
};

class PassRenderer {
 public:
  PassRenderer(const RenderPass &pass, PassQueue &queue, Lane &lane)
      : pass_(pass), queue_(queue), lane_(lane), emission_(pass.photon->emission, queue.memory, queue.stream)
  {}

  void run()
  {
    allocate();
    for (const Batch &batch : batches_) {
      if (queue_.is_cancelled()) return;
      render_batch(batch);
    }
  }

 private:
  // The largest workspace that memory has room for.
  void allocate()
  {
    uint64_t num_pixels = 0, largest_unit = 0;
    for (const WorkUnit &u : pass_.units) {
      const uint64_t area = uint64_t(u.x1 - u.x0) * (u.y1 - u.y0);
      num_pixels += area;
      largest_unit = std::max(largest_unit, area);
    }
    uint64_t most_film = std::max(std::min(num_pixels, most_pixels), largest_unit);
    uint32_t num_flying =
        std::clamp(pass_.photon->settings.photons_per_pass, fewest_in_flight, most_in_flight);
    uint64_t most_paths = most_in_flight;
    for (;;) {
      cut_batches(most_film, most_paths);
      uint64_t film = 0, paths = 0;
      for (const Batch &b : batches_) {
        film = std::max(film, b.num_pixels);
        for (const Batch::Part &p : b.parts) paths = std::max(paths, p.group.num_pixels());
      }
      try {
        work_.emplace(queue_, num_flying, uint32_t(std::min(paths, most_paths)), film, pass_.outputs);
        return;
      } catch (const Error &e) {
        check(cudaStreamSynchronize(queue_.stream), "cudaStreamSynchronize");
        if (e.result() != GPURT_ERROR_OUT_OF_MEMORY) throw;
        if (num_flying <= fewest_in_flight && most_paths <= fewest_in_flight && most_film <= largest_unit)
          throw;
        num_flying = std::max(num_flying / 2, fewest_in_flight);
        most_paths = std::max<uint64_t>(most_paths / 2, fewest_in_flight);
        most_film = std::max(most_film / 2, largest_unit);
      }
    }
  }

  void cut_batches(uint64_t most_film, uint64_t most_paths)
  {
    batches_.clear();
    for (UnitGroup &g : group_units(pass_.units, ~uint64_t(0), std::min(most_film, most_paths))) {
      if (batches_.empty() || batches_.back().num_pixels + g.num_pixels() > most_film) batches_.emplace_back();
      Batch &batch = batches_.back();
      const uint64_t first_pixel = batch.num_pixels;
      batch.num_pixels += g.num_pixels();
      batch.parts.push_back({std::move(g), first_pixel});
    }
  }

  void render_batch(const Batch &batch)
  {
    std::set<uint64_t> samples;
    for (const Batch::Part &p : batch.parts) {
      for (uint64_t k = 0; k < p.group.bounds.num_samples; ++k) samples.insert(p.group.bounds.first_sample + k);
    }
    check(cudaMemsetAsync(work_->film.data(), 0, GroupFilm(batch.num_pixels, pass_.outputs).bytes(),
                          queue_.stream),
          "cudaMemsetAsync");
    queue_.clock.start(queue_.stream);
    for (const uint64_t sample : samples) {
      if (!render_sample(batch, sample)) return;
    }
    deliver_batch(batch);
  }

  FilmView film_of(const Batch::Part &part, std::byte *base) const
  {
    const WorkUnit &u = part.group.bounds;
    // Every part has its own film, one behind the other.
    return GroupFilm(part.group.num_pixels(), pass_.outputs)
        .view(base + GroupFilm(part.first_pixel, pass_.outputs).bytes(), u.x1 - u.x0, u.y1 - u.y0);
  }

  // False: cancelled.
  bool render_sample(const Batch &batch, uint64_t sample)
  {
    const PhotonPass photon_pass = make_photon_pass(pass_.photon->settings, pass_.photon->emission, sample);
    PhotonStore &store = work_->store;
    const PhotonUnit unit{pass_.settings.seed, pass_.settings.frame_index,
                          pass_.settings.max_depth, photon_pass,
                          pass_.photon->settings.photons_per_pass, 0};
    store.begin({queue_.scene.scene, emission_.view(), unit, queue_.has_near()}, photon_pass.num_emitted);
    store.counters.smallest_radius = double(photon_pass.radius);
    check(cudaMemsetAsync(work_->sums.data(), 0, batch.num_pixels * sizeof(PhotonSum), queue_.stream),
          "cudaMemsetAsync");

    uint64_t num_waves = 0;
    for (const Batch::Part &p : batch.parts) {
      if (has_sample(p, sample))
        num_waves += (p.group.num_pixels() + work_->eye.capacity() - 1) / work_->eye.capacity();
    }
    bool is_first = true;
    do {
      if (!store.trace()) return false;
      const PhotonGrid grid = store.build(photon_pass.radius);
      // The paths of a single wave stay for further maps; others are followed again.
      const Maps maps{is_first || num_waves != 1, num_waves == 1 ? is_first : store.is_last(),
                      store.is_last()};
      for (const Batch::Part &p : batch.parts) {
        if (has_sample(p, sample) && !gather_part(p, sample, photon_pass, grid, maps)) return false;
      }
      is_first = false;
    } while (!store.is_last());
    return true;
  }

  // What is to be done with one of a pass's maps.
  struct Maps {
    bool traces_paths, adds_features, is_last;
  };

  static bool has_sample(const Batch::Part &part, uint64_t sample)
  {
    const WorkUnit &u = part.group.bounds;
    return sample >= u.first_sample && sample - u.first_sample < u.num_samples;
  }

  bool gather_part(const Batch::Part &part, uint64_t sample, const PhotonPass &photon_pass,
                   const PhotonGrid &grid, const Maps &maps)
  {
    EyeTracer &eye = work_->eye;
    const WorkUnit &u = part.group.bounds;
    const FilmView film = film_of(part, work_->film.data());
    FilmView features = film;
    if (!maps.adds_features) features.features = nullptr, features.first_hits = nullptr;
    const uint64_t num_pixels = part.group.num_pixels();
    for (uint64_t first = 0; first < num_pixels; first += eye.capacity()) {
      const uint32_t n = uint32_t(std::min<uint64_t>(eye.capacity(), num_pixels - first));
      PhotonSum *sums = work_->sums.data() + part.first_pixel + first;
      const EyePixels pixels{{u.x0, u.y0, u.x1, u.y1, sample, first}, 0};
      if (maps.traces_paths &&
          !(eye.trace_points(pass_.settings, pixels, features, n) && eye.measure_discs(photon_pass, n)))
        return false;
      if (!eye.gather(grid, photon_pass, sums, n)) return false;
      if (maps.is_last) eye.add_samples(photon_pass, sums, film, n);
    }
    return true;
  }

  RenderCounters take_counters()
  {
    const EyeTracer::Counters eye = work_->eye.take_counters();
    double seconds[uint32_t(PhotonLap::Count)] = {};
    queue_.clock.collect(seconds);
    const auto of = [&](PhotonLap lap) { return seconds[uint32_t(lap)]; };
    RenderCounters c;
    c.num_bounce_rays = eye.num_bounce_rays;
    c.num_shadow_rays = eye.num_shadow_rays;
    c.generate_seconds = of(PhotonLap::Generate);
    c.trace_seconds = of(PhotonLap::Trace);
    c.shade_seconds = of(PhotonLap::Shade);
    c.shadow_seconds = of(PhotonLap::Shadow);
    c.film_seconds = of(PhotonLap::Film);
    c.largest_sample = eye.largest_sample;
    c.photon = std::exchange(work_->store.counters, {});
    c.photon.num_gathered = eye.num_gathered;
    c.photon.num_visible = eye.num_visible;
    c.photon.trace_seconds = of(PhotonLap::Photons);
    c.photon.build_seconds = of(PhotonLap::Build);
    c.photon.gather_seconds = of(PhotonLap::Gather);
    return c;
  }

  void deliver_batch(const Batch &batch)
  {
    const uint64_t bytes = GroupFilm(batch.num_pixels, pass_.outputs).bytes();
    std::byte *host = static_cast<std::byte *>(lane_.to_host.reserve(bytes));
    check(cudaMemcpyAsync(host, work_->film.data(), bytes, cudaMemcpyDeviceToHost, queue_.stream),
          "cudaMemcpyAsync");
    const RenderCounters counters = take_counters();
    for (const Batch::Part &p : batch.parts) {
      deliver(pass_, p.group, film_of(p, host), &p == batch.parts.data() ? counters : RenderCounters{});
    }
  }

  const RenderPass &pass_;
  PassQueue &queue_;
  Lane &lane_;
  const DeviceEmission emission_;
  std::vector<Batch> batches_;
  std::optional<Workspace> work_;
};

// Photons in flight and paths of a pilot.
constexpr uint32_t pilot_capacity = uint32_t(1) << 16, smallest_pilot_capacity = uint32_t(1) << 10;

// A pilot's photons and points, in flight up to `capacity` at a time.
PhotonPilot trace_pilot(PassQueue &queue, const PhotonFlight &flight, const PathSettings &settings,
                        uint32_t num_photons, uint32_t points_per_axis, uint32_t capacity)
{
  PhotonPilot pilot;
  const uint32_t num_points = points_per_axis * points_per_axis;
  EyeTracer eye(queue, num_points);
  PhotonStore store(queue, capacity);
  const WaitAtEnd wait(queue.stream);
  queue.clock.start(queue.stream);
  store.begin(flight, num_photons);
  do {
    store.trace();
    const size_t before = pilot.photons.size();
    pilot.photons.resize(before + store.num_records());
    store.read_records(pilot.photons.data() + before);
  } while (!store.is_last());

  eye.trace_points(settings, {{}, points_per_axis}, {}, num_points);
  std::vector<VisiblePoint> points(num_points);
  check(cudaMemcpyAsync(points.data(), eye.points(), num_points * sizeof(VisiblePoint),
                        cudaMemcpyDeviceToHost, queue.stream),
        "cudaMemcpyAsync");
  check(cudaStreamSynchronize(queue.stream), "cudaStreamSynchronize");
  for (const VisiblePoint &p : points) {
    if (p.depth != 0) pilot.points.push_back({p.position, p.normal_code});
  }
  return pilot;
}

}  // namespace

void render_photons_on_device(const RenderPass &pass, const TraceScene &scene,
                              const std::shared_ptr<DeviceMemory> &memory, LanePool &lanes)
{
  if (pass.units.empty()) return;
  const LaneLease lane = lanes.acquire();
  PassQueue queue{scene, memory, lane->stream(), pass.cancelled, {}};
  PassRenderer renderer(pass, queue, *lane);
  const WaitAtEnd wait(lane->stream());
  renderer.run();
}

PhotonPilot photon_pilot_on_device(const PathSettings &settings, const EmissionView &emission,
                                   uint32_t num_photons, uint32_t points_per_axis, const TraceScene &scene,
                                   const std::shared_ptr<DeviceMemory> &memory, LanePool &lanes)
{
  const LaneLease lane = lanes.acquire();
  PassQueue queue{scene, memory, lane->stream(), nullptr, {}};
  const DeviceEmission on_device(emission, memory, lane->stream());
  PhotonPass photon_pass =
      make_photon_pass({num_photons, 1, PhotonKernel::Constant, 0}, emission, 0);
  photon_pass.index = pilot_pass;
  const PhotonFlight flight{scene.scene, on_device.view(),
                            {settings.seed, settings.frame_index, settings.max_depth, photon_pass, num_photons, 0},
                            queue.has_near()};
  for (uint32_t capacity = std::clamp(num_photons, smallest_pilot_capacity, pilot_capacity);; capacity /= 2) {
    try {
      return trace_pilot(queue, flight, settings, photon_pass.num_emitted, points_per_axis, capacity);
    } catch (const Error &e) {
      check(cudaStreamSynchronize(lane->stream()), "cudaStreamSynchronize");
      if (e.result() != GPURT_ERROR_OUT_OF_MEMORY || capacity <= smallest_pilot_capacity) throw;
    }
  }
}

}  // namespace gpurt::cuda
