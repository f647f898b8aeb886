#include "cuda/path/render.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstring>
#include <optional>

#include "cuda/path/pool.h"
#include "cuda/path/unit_groups.h"
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

// A group's film: in device memory, then in pinned host memory in the same layout.
class GroupFilm {
 public:
  GroupFilm(uint64_t num_pixels, uint32_t outputs) : num_pixels_(num_pixels)
  {
    TileFilm one;
    one.reset(1, 1, outputs);
    has_features_ = !one.features.empty();
    has_first_hits_ = !one.first_hits.empty();
  }
  uint64_t bytes() const
  {
    return num_pixels_ * (sizeof(PixelSums) + (has_features_ ? sizeof(PixelFeatures) : 0) +
                          (has_first_hits_ ? sizeof(PixelFirstHit) : 0));
  }
  // The arrays lie one behind the other; sizes of their elements are multiples of 8, as their alignment wants.
  FilmView view(std::byte *base, uint32_t width, uint32_t height) const
  {
    FilmView film{};
    film.width = width;
    film.height = height;
    film.pixels = reinterpret_cast<PixelSums *>(base);
    base += num_pixels_ * sizeof(PixelSums);
    if (has_features_) {
      film.features = reinterpret_cast<PixelFeatures *>(base);
      base += num_pixels_ * sizeof(PixelFeatures);
    }
    if (has_first_hits_) film.first_hits = reinterpret_cast<PixelFirstHit *>(base);
    return film;
  }

 private:
  uint64_t num_pixels_;
  bool has_features_, has_first_hits_;
};
static_assert(sizeof(PixelSums) % 8 == 0 && sizeof(PixelFeatures) % 8 == 0);

template <class T>
void copy_rows(std::vector<T> &to, const T *from, const WorkUnit &unit, const WorkUnit &group)
{
  if (to.empty()) return;
  const uint64_t width = unit.x1 - unit.x0, group_width = group.x1 - group.x0;
  for (uint32_t y = unit.y0; y < unit.y1; ++y) {
    std::memcpy(to.data() + (y - unit.y0) * width, from + (y - group.y0) * group_width + (unit.x0 - group.x0),
                width * sizeof(T));
  }
}

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

// Hands the units of a finished group over, on the host's threads.
void deliver(const RenderPass &pass, const UnitGroup &group, const FilmView &film,
             const WaveCounters &counters)
{
  tbb::enumerable_thread_specific<TileFilm> tiles;
  tbb::parallel_for(size_t(0), group.units.size(), [&](size_t i) {
    const WorkUnit &unit = group.units[i];
    TileFilm &tile = tiles.local();
    tile.reset(unit.x1 - unit.x0, unit.y1 - unit.y0, pass.outputs);
    copy_rows(tile.pixels, film.pixels, unit, group.bounds);
    copy_rows(tile.features, film.features, unit, group.bounds);
    copy_rows(tile.first_hits, film.first_hits, unit, group.bounds);
    // What the group did together is counted with its first unit: only sums matter.
    RenderCounters c = i == 0 ? counters_from(counters) : RenderCounters{};
    c.num_samples = c.num_camera_rays = uint64_t(unit.x1 - unit.x0) * (unit.y1 - unit.y0) * unit.num_samples;
    pass.deliver(unit, tile, c);
  });
}

class PassRenderer {
 public:
  PassRenderer(const RenderPass &pass, const TraceScene &scene, const std::shared_ptr<DeviceMemory> &memory)
      : pass_(pass), scene_(scene), memory_(memory)
  {
    uint64_t num_paths = 0;
    for (const WorkUnit &u : pass.units) num_paths += uint64_t(u.x1 - u.x0) * (u.y1 - u.y0) * u.num_samples;
    const uint64_t group_paths =
        std::clamp(num_paths / (2 * max_wave_lanes), min_group_paths, max_group_paths);
    groups_ = group_units(pass.units, group_paths, max_group_pixels);
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
    for (size_t k; !stop && !is_cancelled() && (k = next_group_++) < groups_.size();)
      render_group(groups_[k], *work, lane);
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
        work->film = {memory_, most_film_bytes_, "the film of a group of units"};
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
    check(cudaMemsetAsync(work.film.data(), 0, layout.bytes(), lane.stream()), "cudaMemsetAsync");
    const FilmView film = layout.view(work.film.data(), width, height);
    WaveCounters counters;
    const uint64_t num_paths = group.num_paths();
    for (uint64_t first = 0; first < num_paths; first += work.capacity()) {
      const PathUnit part{u.x0, u.y0, u.x1, u.y1, u.first_sample, first};
      const uint32_t count = uint32_t(std::min<uint64_t>(work.capacity(), num_paths - first));
      const auto render = [&](auto &&render_part, auto &memory) {
        return render_part(scene_, pass_.settings, part, film, count, pass_.cancelled, memory, lane.stream(),
                           counters);
      };
      const bool is_done = work.pool ? render(render_pool, *work.pool) : render(render_wave, *work.wave);
      if (!is_done) return;
    }
    std::byte *host = static_cast<std::byte *>(lane.to_host.reserve(most_film_bytes_));
    check(cudaMemcpyAsync(host, work.film.data(), layout.bytes(), cudaMemcpyDeviceToHost, lane.stream()),
          "cudaMemcpyAsync");
    lane.synchronize();
    deliver(pass_, group, layout.view(host, width, height), counters);
  }

  const RenderPass &pass_;
  const TraceScene &scene_;
  const std::shared_ptr<DeviceMemory> &memory_;
  std::vector<UnitGroup> groups_;
  uint64_t most_paths_ = 0, most_film_bytes_ = 0;
  std::atomic<size_t> next_group_{0};
  std::mutex allocation_mutex_;
  unsigned num_workspaces_ = 0;
};

}  // namespace

void render_on_device(const RenderPass &pass, const TraceScene &scene,
                      const std::shared_ptr<DeviceMemory> &memory, LanePool &lanes)
{
  if (pass.units.empty()) return;
  PassRenderer renderer(pass, scene, memory);
  run_on_lanes(lanes, memory->ordinal(), renderer.num_lanes(),
               [&](Lane &lane, const std::atomic<bool> &stop) { renderer.run(lane, stop); });
}

}  // namespace gpurt::cuda
