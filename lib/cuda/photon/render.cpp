#include "cuda/photon/render.h"

#include <algorithm>
#include <mutex>
#include <set>

#include "cuda/path/group_film.h"
#include "cuda/photon/device_emission.h"
#include "cuda/photon/eye_tracer.h"
#include "cuda/photon/photon_store.h"
#include "error.h"
#include "render_counters.h"

namespace gpurt::cuda {
namespace {

// Photons and paths that run together. Twice as many, with a lane less, are 6 % faster and take a third more memory; fewer are
// taken where memory is short.
constexpr uint32_t most_in_flight = uint32_t(1) << 21;
constexpr uint32_t fewest_in_flight = uint32_t(1) << 10;
// Passes that are small run together: about as many photons, and paths of the eye, and no more passes than this.
constexpr uint64_t photons_together = uint64_t(1) << 23, paths_together = uint64_t(1) << 21;
constexpr uint32_t most_slots = 64;
static_assert(PassQueue::passes + most_slots * sizeof(PhotonPass) <= PassQueue::pinned_bytes);
// Side by side: while one waits for the numbers of a step, or has few paths left, the others fill the device.
constexpr unsigned most_lanes = 3;
// Pixels whose film is on the device at once: the photons of a pass are traced again for the others.
constexpr uint64_t most_pixels = uint64_t(1) << 25;

// What passes work on.
struct Workspace {
  Workspace(PassQueue &queue, uint32_t num_flying, uint32_t num_paths, uint64_t num_pixels,
            uint32_t num_slots, uint32_t outputs, bool has_blurs)
      : film(queue.memory, GroupFilm(num_pixels, outputs).bytes(), "the film of passes"),
        passes(queue.memory, num_slots, "passes of photons"),
        sums(queue.memory, num_pixels * num_slots, "sums of photons"),
        blurs(has_blurs ? DeviceBuffer<PhotonBlur>(queue.memory, num_pixels * num_slots, "sums of photons")
                        : DeviceBuffer<PhotonBlur>()),
        eye(queue, num_paths),
        store(queue, num_flying, num_slots)
  {}
  DeviceBuffer<std::byte> film;
  DeviceBuffer<PhotonPass> passes;
  DeviceBuffer<PhotonSum> sums;
  DeviceBuffer<PhotonBlur> blurs;  // empty: not wanted
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

// Every part has its own film, one behind the other.
FilmView film_of(const Batch::Part &part, std::byte *base, uint32_t outputs)
{
  const WorkUnit &u = part.group.bounds;
  return GroupFilm(part.group.num_pixels(), outputs)
      .view(base + GroupFilm(part.first_pixel, outputs).bytes(), u.x1 - u.x0, u.y1 - u.y0);
}

// Samples first .. first + count - 1, which run together.
struct SampleRange {
  uint64_t first;
  uint32_t count;
};

// Some samples of all units of a batch, on one lane.
struct SamplesRenderer {
  const RenderPass &pass;
  PassQueue &queue;
  const EmissionView &emission;  // in device memory
  Workspace &space;
  const Batch &batch;
  const SampleRange samples;

  // False: cancelled.
  bool run()
  {
    queue.clock.start(queue.stream);
    const PhotonPass first = set_passes();
    const uint32_t num_emitted = first.num_emitted * samples.count;
    const PhotonFlight flight{queue.scene.scene,
                              emission,
                              space.passes.data(),
                              pass.settings.seed,
                              pass.settings.frame_index,
                              pass.settings.max_depth,
                              pass.photon->settings.photons_per_pass,
                              queue.has_near()};
    PhotonStore &store = space.store;
    store.begin(flight, num_emitted, samples.count);
    check(cudaMemsetAsync(space.sums.data(), 0, space.sums.bytes(), queue.stream), "cudaMemsetAsync");
    if (space.blurs.data() != nullptr)
      check(cudaMemsetAsync(space.blurs.data(), 0, space.blurs.bytes(), queue.stream), "cudaMemsetAsync");

    uint64_t num_waves = 0;
    for (const Batch::Part &p : batch.parts)
      num_waves += (paths_of(p).count + space.eye.capacity() - 1) / space.eye.capacity();
    bool is_first = true;
    do {
      if (!store.trace()) return false;
      // Radii fall from pass to pass.
      const PhotonGrid grid = store.build(first.radius);
      // The paths of a single wave stay for further maps; others are followed again.
      const bool stay = num_waves == 1;
      const Maps maps{is_first || !stay, stay ? is_first : store.is_last(), store.is_last()};
      for (const Batch::Part &p : batch.parts) {
        if (!gather_part(p, grid, maps)) return false;
      }
      is_first = false;
    } while (!store.is_last());
    return true;
  }

 private:
  // What is to be done with one of the passes' maps.
  struct Maps {
    bool traces_paths, adds_features, is_last;
  };

  // Paths of a part: those of its units' samples that are among these.
  struct PartPaths {
    uint64_t first_sample, count;
  };
  PartPaths paths_of(const Batch::Part &part) const
  {
    const WorkUnit &u = part.group.bounds;
    const uint64_t begin = std::max(samples.first, u.first_sample);
    const uint64_t end = std::min(samples.first + samples.count, u.first_sample + u.num_samples);
    return {begin, begin < end ? (end - begin) * part.group.num_pixels() : 0};
  }

  // Hands what the passes are made with to the device, and returns the first of them.
  PhotonPass set_passes()
  {
    auto *host = reinterpret_cast<PhotonPass *>(queue.numbers + PassQueue::passes);
    PhotonCounters radii;
    for (uint32_t k = 0; k < samples.count; ++k) {
      host[k] = make_photon_pass(pass.photon->settings, pass.photon->emission, samples.first + k);
      radii.smallest_radius = double(host[k].radius);
      space.store.counters.add(radii);
    }
    check(cudaMemcpyAsync(space.passes.data(), host, samples.count * sizeof(PhotonPass),
                          cudaMemcpyHostToDevice, queue.stream),
          "cudaMemcpyAsync");
    return host[0];
  }

  bool gather_part(const Batch::Part &part, const PhotonGrid &grid, const Maps &maps)
  {
    EyeTracer &eye = space.eye;
    const WorkUnit &u = part.group.bounds;
    const PartPaths paths = paths_of(part);
    const FilmView film = film_of(part, space.film.data(), pass.outputs);
    FilmView features = film;
    if (!maps.adds_features) features.features = nullptr, features.first_hits = nullptr;
    eye.set_passes(space.passes.data(), uint32_t(paths.first_sample - samples.first));
    for (uint64_t first = 0; first < paths.count; first += eye.capacity()) {
      const uint32_t n = uint32_t(std::min<uint64_t>(eye.capacity(), paths.count - first));
      const uint64_t at = part.first_pixel * samples.count + first;
      const PhotonSums sums{space.sums.data() + at,
                            space.blurs.data() != nullptr ? space.blurs.data() + at : nullptr};
      const EyePixels pixels{{u.x0, u.y0, u.x1, u.y1, paths.first_sample, first}, 0};
      if (maps.traces_paths) {
        if (!eye.trace_points(pass.settings, pass.photon->settings.remedies, pixels, features, n))
          return false;
        if (film.statistics != nullptr) eye.set_radii(film, n);
        if (!eye.measure_discs(pass.photon->settings.remedies, n)) return false;
      }
      if (!eye.gather(grid, sums, n)) return false;
      if (maps.is_last) eye.add_samples(sums, film, n);
    }
    return true;
  }
};

// How large a workspace is.
struct WorkSizes {
  uint32_t num_flying;
  uint64_t most_paths;  // of a wave
  uint64_t most_film;   // pixels of a batch
  uint32_t num_slots;   // passes that run together
};

class PassRenderer {
 public:
  PassRenderer(const RenderPass &pass, const TraceScene &scene, const std::shared_ptr<DeviceMemory> &memory,
               LanePool &lanes)
      : pass_(pass),
        scene_(scene),
        memory_(memory),
        lanes_(lanes),
        lane_(lanes.acquire()),
        emission_(pass.photon->emission, memory, lane_->stream())
  {}

  void run()
  {
    fit();
    for (const Batch &batch : batches_) {
      if (is_cancelled()) return;
      render_batch(batch);
    }
  }

 private:
  bool is_cancelled() const
  {
    return pass_.cancelled != nullptr && pass_.cancelled->load(std::memory_order_relaxed);
  }

  // Passes that go on from what the one before left in the pixels run one after another.
  bool in_order() const { return pass_.photon->settings.estimator != PhotonEstimator::Memoryless; }
  bool has_blurs() const
  {
    return TileFilm::has_errors(pass_.outputs) ||
           pass_.photon->settings.estimator == PhotonEstimator::Adaptive;
  }

  PassQueue queue_on(Lane &lane) const
  {
    return {scene_,
            memory_,
            lane.stream(),
            static_cast<std::byte *>(lane.to_device.reserve(PassQueue::pinned_bytes)),
            pass_.cancelled,
            {},
            {}};
  }

  std::unique_ptr<Workspace> make_workspace(PassQueue &queue) const
  {
    const uint64_t num_paths = std::min(largest_part_ * sizes_.num_slots, sizes_.most_paths);
    return std::make_unique<Workspace>(queue, sizes_.num_flying, uint32_t(num_paths), largest_batch_,
                                       sizes_.num_slots, pass_.outputs, has_blurs());
  }

  // Finds the largest workspace that memory has room for.
  void fit()
  {
    uint64_t num_pixels = 0, largest_unit = 0, most_samples = 0;
    for (const WorkUnit &u : pass_.units) {
      const uint64_t area = uint64_t(u.x1 - u.x0) * (u.y1 - u.y0);
      num_pixels += area;
      largest_unit = std::max(largest_unit, area);
      most_samples = std::max(most_samples, u.num_samples);
    }
    const uint64_t num_photons = pass_.photon->settings.photons_per_pass;
    const uint64_t num_slots =
        in_order() ? 1
                   : std::max<uint64_t>(std::min({photons_together / num_photons, paths_together / num_pixels,
                                                  uint64_t(most_slots), most_samples}),
                                        1);
    sizes_ = {uint32_t(std::clamp<uint64_t>(num_photons * num_slots, fewest_in_flight, most_in_flight)),
              most_in_flight, std::max(std::min(num_pixels, most_pixels), largest_unit), uint32_t(num_slots)};
    PassQueue queue = queue_on(*lane_);
    for (;;) {
      cut_batches();
      try {
        const std::unique_ptr<Workspace> fits = make_workspace(queue);
        check(cudaStreamSynchronize(queue.stream), "cudaStreamSynchronize");
        return;
      } catch (const Error &e) {
        check(cudaStreamSynchronize(queue.stream), "cudaStreamSynchronize");
        if (e.result() != GPURT_ERROR_OUT_OF_MEMORY) throw;
        if (sizes_.num_flying <= fewest_in_flight && sizes_.most_paths <= fewest_in_flight &&
            sizes_.most_film <= largest_unit && sizes_.num_slots == 1)
          throw;
        sizes_ = {std::max(sizes_.num_flying / 2, fewest_in_flight),
                  std::max<uint64_t>(sizes_.most_paths / 2, fewest_in_flight),
                  std::max(sizes_.most_film / 2, largest_unit), std::max(sizes_.num_slots / 2, 1u)};
      }
    }
  }

  void cut_batches()
  {
    batches_.clear();
    largest_batch_ = largest_part_ = 0;
    for (UnitGroup &g :
         group_units(pass_.units, ~uint64_t(0), std::min(sizes_.most_film, sizes_.most_paths))) {
      const uint64_t num_pixels = g.num_pixels();
      if (batches_.empty() || batches_.back().num_pixels + num_pixels > sizes_.most_film)
        batches_.emplace_back();
      Batch &batch = batches_.back();
      batch.parts.push_back({std::move(g), batch.num_pixels});
      batch.num_pixels += num_pixels;
      largest_part_ = std::max(largest_part_, num_pixels);
      largest_batch_ = std::max(largest_batch_, batch.num_pixels);
    }
  }

  // What the lanes of a batch share.
  struct BatchWork {
    const Batch &batch;
    std::vector<SampleRange> samples = {};
    std::atomic<size_t> next = 0;
    std::atomic<bool> is_complete = true;  // false: cancelled
    std::mutex mutex = {};
    unsigned num_workspaces = 0;
    DeviceBuffer<std::byte> film = {};  // of the lanes that have ended
    RenderCounters counters = {};
  };

  void render_batch(const Batch &batch)
  {
    BatchWork work{batch};
    std::set<uint64_t> samples;
    for (const Batch::Part &p : batch.parts) {
      for (uint64_t k = 0; k < p.group.bounds.num_samples; ++k)
        samples.insert(p.group.bounds.first_sample + k);
    }
    for (const uint64_t sample : samples) {
      if (!work.samples.empty()) {
        SampleRange &last = work.samples.back();
        if (last.first + last.count == sample && last.count < sizes_.num_slots) {
          ++last.count;
          continue;
        }
      }
      work.samples.push_back({sample, 1});
    }
    const unsigned num_lanes = unsigned(std::min<uint64_t>(work.samples.size(), in_order() ? 1 : most_lanes));
    run_on_lanes(lanes_, memory_->ordinal(), num_lanes,
                 [&](Lane &lane, const std::atomic<bool> &stop) { render_samples(work, lane, stop); });
    if (work.is_complete && !is_cancelled()) deliver_batch(work);
  }

  // Renders samples until none are left. Lanes that find no memory leave the work to others.
  void render_samples(BatchWork &work, Lane &lane, const std::atomic<bool> &stop) const
  {
    PassQueue queue = queue_on(lane);
    std::unique_ptr<Workspace> space;
    try {
      const std::lock_guard lock(work.mutex);
      space = make_workspace(queue);
      ++work.num_workspaces;
    } catch (const Error &e) {
      lane.synchronize();
      const std::lock_guard lock(work.mutex);
      if (e.result() == GPURT_ERROR_OUT_OF_MEMORY && work.num_workspaces != 0) return;
      throw;
    }
    const WaitAtEnd wait(queue.stream);
    check(cudaMemsetAsync(space->film.data(), 0, space->film.bytes(), queue.stream), "cudaMemsetAsync");
    copy_statistics(work.batch, space->film.data(), queue.stream);
    RenderCounters counters;
    double seconds[uint32_t(PhotonLap::Count)] = {};
    for (size_t k; (k = work.next++) < work.samples.size();) {
      if (stop ||
          !SamplesRenderer{pass_, queue, emission_.view(), *space, work.batch, work.samples[k]}.run()) {
        work.is_complete = false;
        return;
      }
      lane.synchronize();
      queue.clock.collect(seconds);
    }
    add_to(work, *space, queue, take_counters(*space, seconds));
  }

  // Films start with what the pixels of the frame have.
  void copy_statistics(const Batch &batch, std::byte *film, cudaStream_t stream) const
  {
    if (!(pass_.outputs & film_statistics)) return;
    const uint64_t frame_width = pass_.settings.camera.width;
    for (const Batch::Part &p : batch.parts) {
      const WorkUnit &u = p.group.bounds;
      const uint64_t row_bytes = (u.x1 - u.x0) * sizeof(PixelStatistics);
      check(cudaMemcpy2DAsync(film_of(p, film, pass_.outputs).statistics, row_bytes,
                              pass_.statistics + u.y0 * frame_width + u.x0,
                              frame_width * sizeof(PixelStatistics), row_bytes, u.y1 - u.y0,
                              cudaMemcpyHostToDevice, stream),
            "cudaMemcpy2DAsync");
    }
  }

  static RenderCounters take_counters(Workspace &space, const double (&seconds)[uint32_t(PhotonLap::Count)])
  {
    const EyeTracer::Counters eye = space.eye.take_counters();
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
    c.photon = space.store.counters;
    c.photon.num_gathered = eye.num_gathered;
    c.photon.num_visible = eye.num_visible;
    c.photon.emit_seconds = of(PhotonLap::Emit);
    c.photon.scatter_seconds = of(PhotonLap::Scatter);
    c.photon.trace_seconds = of(PhotonLap::Photons) + c.photon.emit_seconds + c.photon.scatter_seconds;
    c.photon.build_seconds = of(PhotonLap::Build);
    c.photon.gather_seconds = of(PhotonLap::Gather);
    return c;
  }

  // Adds what a lane has to what others had.
  void add_to(BatchWork &work, Workspace &space, PassQueue &queue, const RenderCounters &counters) const
  {
    const std::lock_guard lock(work.mutex);
    add_counters(work.counters, counters);
    if (work.film.data() == nullptr) {
      work.film = std::move(space.film);
      return;
    }
    for (const Batch::Part &p : work.batch.parts) {
      launch_add_film(film_of(p, work.film.data(), pass_.outputs),
                      film_of(p, space.film.data(), pass_.outputs), queue.stream);
    }
    check(cudaStreamSynchronize(queue.stream), "cudaStreamSynchronize");
  }

  void deliver_batch(BatchWork &work)
  {
    const uint64_t bytes = GroupFilm(work.batch.num_pixels, pass_.outputs).bytes();
    std::byte *host = static_cast<std::byte *>(lane_->to_host.reserve(bytes));
    check(cudaMemcpyAsync(host, work.film.data(), bytes, cudaMemcpyDeviceToHost, lane_->stream()),
          "cudaMemcpyAsync");
    lane_->synchronize();
    for (const Batch::Part &p : work.batch.parts) {
      deliver(pass_, p.group, film_of(p, host, pass_.outputs),
              &p == work.batch.parts.data() ? work.counters : RenderCounters{});
    }
  }

  const RenderPass &pass_;
  const TraceScene &scene_;
  const std::shared_ptr<DeviceMemory> &memory_;
  LanePool &lanes_;
  const LaneLease lane_;
  const DeviceEmission emission_;
  WorkSizes sizes_{};
  std::vector<Batch> batches_;
  uint64_t largest_batch_ = 0, largest_part_ = 0;  // in pixels
};

// Photons in flight and paths of a pilot.
constexpr uint32_t pilot_capacity = uint32_t(1) << 16, smallest_pilot_capacity = uint32_t(1) << 10;

// What a pilot runs on.
struct PilotSpace {
  PilotSpace(PassQueue &queue, uint32_t num_points, uint32_t capacity)
      : eye(queue, num_points), store(queue, capacity, 1)
  {}
  EyeTracer eye;
  PhotonStore store;
};

std::unique_ptr<PilotSpace> make_pilot_space(PassQueue &queue, uint32_t num_points, uint32_t num_paths)
{
  for (uint32_t capacity = std::clamp(num_paths, smallest_pilot_capacity, pilot_capacity);; capacity /= 2) {
    try {
      return std::make_unique<PilotSpace>(queue, num_points, capacity);
    } catch (const Error &e) {
      check(cudaStreamSynchronize(queue.stream), "cudaStreamSynchronize");
      if (e.result() != GPURT_ERROR_OUT_OF_MEMORY || capacity <= smallest_pilot_capacity) throw;
    }
  }
}

}  // namespace

void render_photons_on_device(const RenderPass &pass, const TraceScene &scene,
                              const std::shared_ptr<DeviceMemory> &memory, LanePool &lanes)
{
  if (pass.units.empty()) return;
  PassRenderer(pass, scene, memory, lanes).run();
}

PhotonPilot photon_pilot_on_device(const PathSettings &settings, const EmissionView &emission,
                                   uint32_t num_paths, uint32_t points_per_axis, const TakePilotPhotons &take,
                                   const TraceScene &scene, const std::shared_ptr<DeviceMemory> &memory,
                                   LanePool &lanes)
{
  const LaneLease lane = lanes.acquire();
  PassQueue queue{scene,
                  memory,
                  lane->stream(),
                  static_cast<std::byte *>(lane->to_device.reserve(PassQueue::pinned_bytes)),
                  nullptr,
                  {},
                  {}};
  const DeviceEmission on_device(emission, memory, lane->stream());
  PhotonPass photon_pass = make_photon_pass({num_paths, 1, PhotonKernel::Constant, 0}, emission, 0);
  photon_pass.index = pilot_pass;
  const DeviceBuffer<PhotonPass> passes =
      upload(memory, std::span<const PhotonPass>(&photon_pass, 1), "a pass of photons", lane->stream());
  const PhotonFlight flight{scene.scene,          on_device.view(),   passes.data(), settings.seed,
                            settings.frame_index, settings.max_depth, num_paths,     queue.has_near()};
  const uint32_t num_points = points_per_axis * points_per_axis;
  const std::unique_ptr<PilotSpace> space = make_pilot_space(queue, num_points, num_paths);
  const WaitAtEnd wait(queue.stream);
  queue.clock.start(queue.stream);
  space->eye.clear_points(num_points);
  space->eye.trace_points(settings, 0, {{}, points_per_axis}, {}, num_points);
  std::vector<VisiblePoint> points(num_points);
  check(cudaMemcpyAsync(points.data(), space->eye.points(), num_points * sizeof(VisiblePoint),
                        cudaMemcpyDeviceToHost, queue.stream),
        "cudaMemcpyAsync");
  check(cudaStreamSynchronize(queue.stream), "cudaStreamSynchronize");
  PhotonPilot pilot;
  for (const VisiblePoint &p : points) {
    if (p.depth != 0) pilot.points.push_back({p.position, p.normal_code});
  }

  PhotonStore &store = space->store;
  store.begin(flight, photon_pass.num_emitted, 1);
  std::vector<Photon> photons;
  do {
    store.trace();
    photons.resize(store.num_records());
    store.read_records(photons.data());
    take(pilot.points, photons);
    pilot.num_photons += photons.size();
  } while (!store.is_last());
  return pilot;
}

}  // namespace gpurt::cuda
