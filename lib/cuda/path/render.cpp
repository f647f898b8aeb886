#include "cuda/path/render.h"

#include <algorithm>
#include <mutex>
#include <optional>

#include "cuda/path/device_film.h"
#include "cuda/path/group_film.h"
#include "cuda/path/pool.h"
#include "cuda/path/wave.h"
#include "error.h"
#include "memory.h"

namespace gpurt::cuda {
namespace {

// Waves side by side: while one shrinks to its last paths, or its film travels, another fills the device.
constexpr unsigned max_wave_lanes = 2;
// Paths that run together. More no longer help the device; fewer are taken where memory is short.
constexpr uint32_t max_wave_paths = uint32_t(1) << 21;
constexpr uint32_t min_wave_paths = uint32_t(1) << 14;
// A group is delivered as a whole, and lost as a whole when a job is cancelled: about a tenth of a second.
constexpr uint64_t max_group_paths = uint64_t(1) << 23;
constexpr uint64_t max_group_pixels = uint64_t(1) << 19;
// Small images are cut, so that every lane has something to do while another delivers.
constexpr uint64_t min_group_paths = uint64_t(1) << 19;

class PassRenderer {
 public:
  PassRenderer(const RenderPass &pass, const TraceScene &scene, const std::shared_ptr<DeviceMemory> &memory)
      : pass_(pass), scene_(scene), memory_(memory), device_film_(reserved_film(pass))
  {
    groups_ = make_groups(pass.units);
    renders_in_place_ = device_film_ != nullptr && device_film_->takes_whole(groups_);
    for (const UnitGroup &g : groups_) {
      most_paths_ = std::max(most_paths_, g.num_paths());
      most_film_bytes_ = std::max(most_film_bytes_, GroupFilm(g.num_pixels(), pass.outputs).bytes());
    }
  }

  unsigned num_lanes() const { return unsigned(std::min<uint64_t>(groups_.size(), max_wave_lanes)); }

  // Renders groups until none are left. Lanes that find no memory leave the work to others.
  void run(Lane &lane, const std::atomic<bool> &stop)
  {
    const std::unique_ptr<Workspace> work = allocate(lane.stream());
    if (!work) return;
    const WaitAtEnd wait(lane.stream());
    for (UnitGroup group; !stop && !is_cancelled() && take_group(group);) render_group(group, *work, lane);
  }

 private:
  // One of wave and pool is there, as the schedule wants it.
  struct Workspace {
    std::optional<WaveMemory> wave;
    std::optional<PoolMemory> pool;
    DeviceBuffer<std::byte> film;

    // Paths that are rendered at a time.
    uint64_t capacity() const { return pool ? pool->unit_capacity() : wave->capacity(); }
  };

  bool is_cancelled() const
  {
    return pass_.cancelled != nullptr && pass_.cancelled->load(std::memory_order_relaxed);
  }

  static std::vector<UnitGroup> make_groups(std::span<const WorkUnit> units)
  {
    uint64_t num_paths = 0;
    for (const WorkUnit &u : units) num_paths += uint64_t(u.x1 - u.x0) * (u.y1 - u.y0) * u.num_samples;
    const uint64_t group_paths =
        std::clamp(num_paths / (2 * max_wave_lanes), min_group_paths, max_group_paths);
    return group_units(units, group_paths, max_group_pixels);
  }

  // False: none is left.
  bool take_group(UnitGroup &group)
  {
    const std::lock_guard lock(groups_mutex_);
    if (next_group_ == groups_.size() && pass_.more) {
      groups_ = make_groups(pass_.more());
      next_group_ = 0;
    }
    if (next_group_ == groups_.size()) return false;
    group = std::move(groups_[next_group_++]);
    return true;
  }

  // The largest wave that memory has room for; null if there is none but another lane has one.
  std::unique_ptr<Workspace> allocate(cudaStream_t stream)
  {
    const std::lock_guard lock(allocation_mutex_);
    uint32_t capacity = uint32_t(std::min<uint64_t>(most_paths_, max_wave_paths));
    for (;;) {
      try {
        auto work = std::make_unique<Workspace>();
        if (pass_.schedule.generation == Generation::Refilled)
          work->pool.emplace(memory_, capacity, most_paths_, pass_.schedule, stream);
        else work->wave.emplace(memory_, capacity, pass_.schedule, stream);
        if (!renders_in_place_) work->film = {memory_, most_film_bytes_, "the film of a group of units"};
        ++num_workspaces_;
        return work;
      } catch (const Error &e) {
        if (e.result() != GPURT_ERROR_OUT_OF_MEMORY) throw;
        if (num_workspaces_ != 0) return nullptr;
        if (capacity <= min_wave_paths) throw;
        capacity = std::max(capacity / 2, min_wave_paths);
      }
    }
  }

  void render_group(const UnitGroup &group, Workspace &work, Lane &lane)
  {
    const WorkUnit &u = group.bounds;
    const uint32_t width = u.x1 - u.x0, height = u.y1 - u.y0;
    const GroupFilm layout(group.num_pixels(), pass_.outputs);
    if (!renders_in_place_ && work.film.size() < layout.bytes())
      work.film = {memory_, layout.bytes(), "the film of a group of units"};
    std::byte *const data = renders_in_place_ ? device_film_->data() : work.film.data();
    check(cudaMemsetAsync(data, 0, layout.bytes(), lane.stream()), "cudaMemsetAsync");
    const FilmView film = layout.view(data, width, height);
    WaveCounters counters;
    const uint64_t num_paths = group.num_paths();
    for (uint64_t first = 0; first < num_paths; first += work.capacity()) {
      const PathUnit part{u.x0, u.y0, u.x1, u.y1, u.first_sample, first};
      const uint32_t count = uint32_t(std::min<uint64_t>(work.capacity(), num_paths - first));
      const auto render = [&](auto &memory, auto &&render_part) {
        return render_part(scene_, pass_.settings, part, film, count, pass_.cancelled, memory, lane.stream(),
                           counters);
      };
      const bool is_done =
          work.pool ? render(*work.pool, render_pool)
                    : render(*work.wave, [](auto &&...arguments) { return render_wave(arguments...); });
      if (!is_done) return;
    }
    hand_over(pass_, group, data, lane, counters_from(counters), true);
  }

  const RenderPass &pass_;
  const TraceScene &scene_;
  const std::shared_ptr<DeviceMemory> &memory_;
  CudaFilm *const device_film_;    // null: units go to the host
  bool renders_in_place_ = false;  // in the memory of that film
  std::mutex groups_mutex_;
  std::vector<UnitGroup> groups_;
  size_t next_group_ = 0;
  uint64_t most_paths_ = 0, most_film_bytes_ = 0;
  std::mutex allocation_mutex_;
  unsigned num_workspaces_ = 0;
};

}  // namespace

RenderCounters counters_from(const WaveCounters &wave)
{
  RenderCounters c;
  c.num_bounce_rays = wave.num_bounce_rays;
  c.num_shadow_rays = wave.num_shadow_rays;
  c.generate_seconds = wave.stage_seconds[uint32_t(PathStage::Generate)];
  c.trace_seconds = wave.stage_seconds[uint32_t(PathStage::Trace)];
  c.shade_seconds = wave.stage_seconds[uint32_t(PathStage::Shade)];
  c.shadow_seconds = wave.stage_seconds[uint32_t(PathStage::Shadow)];
  c.film_seconds = wave.stage_seconds[uint32_t(PathStage::Film)];
  c.largest_sample = wave.largest_sample;
  c.schedule = wave.schedule;
  return c;
}

void render_on_device(const RenderPass &pass, const TraceScene &scene,
                      const std::shared_ptr<DeviceMemory> &memory, LanePool &lanes)
{
  if (pass.units.empty()) return;
  PassRenderer renderer(pass, scene, memory);
  run_on_lanes(lanes, memory->ordinal(), renderer.num_lanes(),
               [&](Lane &lane, const std::atomic<bool> &stop) { renderer.run(lane, stop); });
}

}  // namespace gpurt::cuda
