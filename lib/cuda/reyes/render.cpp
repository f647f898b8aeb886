#include "cuda/reyes/render.h"

#include <algorithm>
#include <optional>

#include "cuda/path/device_film.h"
#include "cuda/path/group_film.h"
#include "cuda/path/render.h"
#include "cuda/path/wave.h"
#include "cuda/reyes/blended_samples.h"
#include "cuda/reyes/lit_points.h"
#include "cuda/reyes/visible.h"
#include "error.h"
#include "memory.h"

namespace gpurt::cuda {
namespace {

// What a group splits and dices serves all of its samples, so groups are as large as memory lets them be.
constexpr uint64_t max_group_samples = uint64_t(1) << 25;
constexpr uint64_t max_group_pixels = uint64_t(1) << 22;
constexpr uint64_t min_group_samples = uint64_t(1) << 12;
// Where surfaces blend, samples take several times the memory.
constexpr uint64_t max_blended_samples = uint64_t(1) << 22;
// Fragments that are kept at a time.
constexpr uint64_t max_fragments = uint64_t(1) << 24;
constexpr uint64_t min_fragments = uint64_t(1) << 12;
// Paths that are shaded together.
constexpr uint32_t max_wave_paths = uint32_t(1) << 21;
constexpr uint32_t min_wave_paths = uint32_t(1) << 12;
// Each level takes half the memory of the last one.
constexpr unsigned num_levels = 14;

class ReyesRenderer {
 public:
  ReyesRenderer(const RenderPass &pass, const TraceScene &scene, const ReyesDeviceScene &reyes,
                const std::shared_ptr<DeviceMemory> &memory)
      : pass_(pass),
        scene_(scene),
        reyes_(reyes),
        memory_(memory),
        device_film_(reserved_film(pass)),
        needs_rays_(pass.reyes->no_shadows == 0 || reyes.has_found_light || pass.reyes->lights_by_rays != 0)
  {}

  void run(Lane &lane, const std::atomic<bool> &stop)
  {
    const std::unique_ptr<Workspace> work = allocate(lane);
    const WaitAtEnd wait(lane.stream()), wait_beside(lane.stream_beside());
    for (const UnitGroup &group : work->groups) {
      if (stop || is_cancelled() || !render_group(group, *work, lane)) return;
    }
  }

 private:
  struct Workspace {
    std::vector<UnitGroup> groups;
    std::optional<VisibleSamples> samples;
    std::optional<BlendedSamples> blended;
    std::optional<LitPoints> points;
    std::optional<WaveMemory> wave;
    DeviceBuffer<std::byte> film;
    bool renders_in_place = false;  // in the memory of the frame's film
  };

  bool is_cancelled() const
  {
    return pass_.cancelled != nullptr && pass_.cancelled->load(std::memory_order_relaxed);
  }

  // The largest groups, waves and lists that memory has room for, in this order.
  std::unique_ptr<Workspace> allocate(Lane &lane) const
  {
    for (unsigned step = 0;; ++step) {
      try {
        return allocate_level(step / 2, step % 2 != 0, lane);
      } catch (const Error &e) {
        if (e.result() != GPURT_ERROR_OUT_OF_MEMORY || step + 1 == 2 * num_levels) throw;
      }
    }
  }

  // As few groups as the limits allow, and these as small as so many can be: memory is taken for the largest.
  std::vector<UnitGroup> make_groups(uint64_t most_samples, uint64_t most_pixels) const
  {
    std::vector<UnitGroup> groups = group_units(pass_.units, most_samples, most_pixels);
    if (groups.size() == 1) return groups;
    uint64_t num_pixels = 0, row_pixels = 0;
    for (const UnitGroup &g : groups) {
      num_pixels += g.num_pixels();
      for (const WorkUnit &u : g.units)
        row_pixels = std::max(row_pixels, uint64_t(g.bounds.x1 - g.bounds.x0) * (u.y1 - u.y0));
    }
    // Groups are of whole rows of units mostly.
    const uint64_t share = (num_pixels + groups.size() - 1) / groups.size();
    for (const uint64_t limit : {share, share + row_pixels}) {
      if (limit >= most_pixels) break;
      std::vector<UnitGroup> even = group_units(pass_.units, most_samples, limit);
      if (even.size() == groups.size()) return even;
    }
    return groups;
  }

  std::unique_ptr<Workspace> allocate_level(unsigned level, bool has_spare_lists, Lane &lane) const
  {
    auto work = std::make_unique<Workspace>();
    const uint64_t most_samples = reyes_.has_blending ? max_blended_samples : max_group_samples;
    work->groups = make_groups(std::max(most_samples >> level, min_group_samples), max_group_pixels >> level);
    uint64_t num_samples = 1, num_cells = 1, most_samples_per_pixel = 1, film_bytes = 0;
    for (const UnitGroup &g : work->groups)
      most_samples_per_pixel = std::max(most_samples_per_pixel, g.bounds.num_samples);
    const bool has_masks = VisibleSamples::suits_masks(reyes_, *pass_.reyes, most_samples_per_pixel);
    for (const UnitGroup &g : work->groups) {
      num_samples = std::max(num_samples, g.num_paths());
      num_cells = std::max(num_cells, VisibleSamples::cells_of(g.bounds, *pass_.reyes, has_masks));
      film_bytes = std::max(film_bytes, GroupFilm(g.num_pixels(), pass_.outputs).bytes());
    }
    work->samples.emplace(memory_, reyes_, *pass_.reyes, pass_.reyes_schedule,
                          ReyesListSizes::at_level(level, has_spare_lists, reyes_.num_roots), num_samples,
                          num_cells, has_masks, lane.to_device);
    if (reyes_.has_blending)
      work->blended.emplace(memory_, num_samples, std::max(max_fragments >> level, min_fragments),
                            pass_.reyes->fragment_slots, needs_rays_);
    if (pass_.reyes->lights_by_rays != 0) work->points.emplace(memory_, num_samples);
    const uint32_t wave_paths = std::max(max_wave_paths >> level, min_wave_paths);
    if (needs_rays_)
      work->wave.emplace(memory_, uint32_t(std::min<uint64_t>(num_samples, wave_paths)), pass_.schedule,
                         lane.stream());
    work->renders_in_place = device_film_ != nullptr && device_film_->takes_whole(work->groups);
    if (!work->renders_in_place) work->film = {memory_, film_bytes, "the film of a group of units"};
    return work;
  }

  // False: cancelled.
  bool render_group(const UnitGroup &group, Workspace &work, Lane &lane) const
  {
    const WorkUnit &u = group.bounds;
    VisibleSamples &samples = *work.samples;
    RenderCounters counters;
    const GroupFilm layout(group.num_pixels(), pass_.outputs);
    std::byte *const data = work.renders_in_place ? device_film_->data() : work.film.data();
    const FilmView film = layout.view(data, u.x1 - u.x0, u.y1 - u.y0);
    if (!samples.find(u, pass_.settings, film, pass_.cancelled, lane.stream(), lane.stream_beside(),
                      counters.reyes))
      return false;

    // Where samples have light of their own every pixel is written.
    const bool has_light = keeps_own_light(*pass_.reyes);
    if (!has_light) check(cudaMemsetAsync(data, 0, layout.bytes(), lane.stream()), "cudaMemsetAsync");
    WaveCounters wave_counters;
    if (work.blended) {
      if (!blend(group, work, film, lane, counters.reyes, wave_counters)) return false;
    } else if (work.points) {
      if (!work.points->run(scene_, pass_.settings, reyes_.has_found_light, *pass_.reyes, samples, *work.wave,
                            film, pass_.cancelled, lane.stream(), counters.reyes, wave_counters))
        return false;
    } else if (has_light) {
      // The film has it.
    } else if (!needs_rays_) samples.shade_at_once(pass_.settings, film, lane.stream());
    else if (!shade_with_rays(group, work, film, lane, wave_counters)) return false;
    lane.synchronize();
    const ReyesCounters found = counters.reyes;
    counters = counters_from(wave_counters);
    counters.reyes = found;
    samples.collect(lane.stream(), counters);
    counters.reyes.working_bytes = samples.bytes() + (work.blended ? work.blended->bytes() : 0) +
                                   (work.points ? work.points->bytes() : 0);
    hand_over(pass_, group, data, lane, counters, false);
    return true;
  }

  // Blends what samples see through surfaces. False: cancelled.
  bool blend(const UnitGroup &group, Workspace &work, const FilmView &film, Lane &lane,
             ReyesCounters &counters, WaveCounters &wave_counters) const
  {
    const WorkUnit &u = group.bounds;
    const auto shade = [&](const Blending &blending, uint32_t num_items) {
      const uint32_t capacity = work.wave->capacity();
      RayStandIns stand_ins;
      stand_ins.no_shadows = pass_.reyes->no_shadows != 0;
      for (uint32_t first = 0; first < num_items; first += capacity) {
        const uint32_t count = std::min(capacity, num_items - first);
        stand_ins.eye_hits = [&](const PathUnit &, const PathWave &wave, uint32_t n, cudaStream_t stream) {
          launch_make_shown_paths(blending, wave, first, n, stream);
        };
        // Paths are items, not samples: they go to no film from here.
        if (!render_wave(scene_, pass_.settings, {u.x0, u.y0, u.x1, u.y1, u.first_sample, 0}, FilmView{},
                         count, pass_.cancelled, *work.wave, lane.stream(), wave_counters, stand_ins)) {
          return false;
        }
        launch_add_shown(blending, work.wave->wave(), first, count, lane.stream());
      }
      wave_counters.largest_sample = 0;
      return true;
    };
    return work.blended->run(u, pass_.settings, *work.samples, shade, film, pass_.cancelled, lane.stream(),
                             counters);
  }

  // Path tracing's stages with what samples see in place of eye rays' hits. False: cancelled.
  bool shade_with_rays(const UnitGroup &group, Workspace &work, const FilmView &film, Lane &lane,
                       WaveCounters &counters) const
  {
    const WorkUnit &u = group.bounds;
    RayStandIns stand_ins;
    stand_ins.eye_hits = [&](const PathUnit &unit, const PathWave &wave, uint32_t n, cudaStream_t stream) {
      work.samples->write_eye_hits(pass_.settings, unit, wave, n, stream);
    };
    stand_ins.no_shadows = pass_.reyes->no_shadows != 0;
    const uint64_t num_paths = group.num_paths(), capacity = work.wave->capacity();
    for (uint64_t first = 0; first < num_paths; first += capacity) {
      const PathUnit part{u.x0, u.y0, u.x1, u.y1, u.first_sample, first};
      const uint32_t count = uint32_t(std::min<uint64_t>(capacity, num_paths - first));
      if (!render_wave(scene_, pass_.settings, part, film, count, pass_.cancelled, *work.wave, lane.stream(),
                       counters, stand_ins)) {
        return false;
      }
    }
    return true;
  }

  const RenderPass &pass_;
  const TraceScene &scene_;
  const ReyesDeviceScene &reyes_;
  const std::shared_ptr<DeviceMemory> &memory_;
  CudaFilm *const device_film_;  // null: units go to the host
  const bool needs_rays_;
};

}  // namespace

ReyesSchedule resolve_reyes_schedule(const Schedule &asked, const ReyesSettings &settings)
{
  ReyesSchedule s{asked.launch, asked.traversal};
  set_default(s.split, Launch::Rounds);
  set_default(s.stages, Traversal::Stack);
  if (s.split == Launch::Regular) s.places = asked.compaction;
  if (s.stages == Traversal::Stack) return s;
  const char *stages = s.stages == Traversal::Uber ? "GPURT_TRAVERSAL_UBER" : "GPURT_TRAVERSAL_LEAF_LISTS";
  if (settings.shading == ReyesShading::Samples) {
    fail(
        GPURT_ERROR_UNSUPPORTED,
        "schedule.traversal is {}, which schedules dicing, shading and sampling of micropolygons with light "
        "of their own; use GPURT_REYES_SHADING_MICROPOLYGONS or GPURT_REYES_SHADING_BLOCKS, or leave it AUTO",
        stages);
  }
  if (settings.lights_by_rays != 0) {
    fail(GPURT_ERROR_UNSUPPORTED,
         "schedule.traversal is {}, which schedules the shading of micropolygons before visibility; here "
         "their "
         "light is found after it, for shadows, lamps, an environment, alpha masks, meshes or other outputs: "
         "set no_shadows, leave these out, or leave schedule.traversal AUTO",
         stages);
  }
  return s;
}

void render_reyes_on_device(const RenderPass &pass, const TraceScene &scene, const ReyesDeviceScene &reyes,
                            const std::shared_ptr<DeviceMemory> &memory, LanePool &lanes)
{
  if (pass.units.empty()) return;
  if (reyes.num_roots > max_roots) {
    fail_invalid("the scene has {} patches and triangles through its instances; REYES takes at most {}",
                 reyes.num_roots, max_roots);
  }
  ReyesRenderer renderer(pass, scene, reyes, memory);
  run_on_lanes(lanes, memory->ordinal(), 1,
               [&](Lane &lane, const std::atomic<bool> &stop) { renderer.run(lane, stop); });
}

}  // namespace gpurt::cuda
