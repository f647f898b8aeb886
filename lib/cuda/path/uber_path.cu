// Whole paths in one kernel: a lane has a path, which waits to be traced, shaded or seen from a light, and a warp turns by
// vote to what most of its paths wait for.
//
// Source: the talk's uber-kernel; Laine, Karras and Aila 2013 for what speaks against it. All a path needs lies in its slot
// of the wave, so that the stages are those of the other schedules.
#include "cuda/path/uber_path.h"

#include "cuda/accel/dispatch.h"
#include "cuda/accel/schedule/ray_work.h"

namespace gpurt::cuda {
namespace {

enum class Mode : uint32_t { Idle = 0, Trace = 1, Shade = 2, Shadow = 3 };

// Idle lanes for which a warp draws paths.
constexpr int refill_lanes = 8;

struct Paths {
  PathSettings settings;
  PathUnit unit;
  PathWave wave;
  uint32_t first, count;
};

template <class Variant>
__global__ void __launch_bounds__(block_size)
    uber_path_kernel(const __grid_constant__ TraceScene s, const __grid_constant__ Paths p, RayPool pool,
                     UberPathCounters *counters)
{
  const PathWave &wave = p.wave;
  const bool is_persistent = pool.num_drawn != nullptr;
  Mode mode = Mode::Idle, work = Mode::Trace;
  bool pool_is_empty = false, has_next = false;
  uint32_t i = 0, depth = 1;
  uint32_t num_refills = 0, num_switches = 0, num_bounces = 0, num_shadows = 0;
  for (;;) {
    const unsigned idle = __ballot_sync(all_lanes, mode == Mode::Idle);
    if (!pool_is_empty && (idle == all_lanes || (is_persistent && __popc(idle) >= refill_lanes))) {
      const unsigned count = __popc(idle);
      const uint64_t first = is_persistent ? draw(pool, count) : thread_item() - lane_index();
      if (first < p.count) ++num_refills;
      pool_is_empty = !is_persistent || first + count >= p.count;
      const uint64_t k = first + __popc(idle & lanes_below());
      if (mode == Mode::Idle && k < p.count) {
        i = p.first + uint32_t(k);
        GenerateCameraRays{p.settings, p.unit, wave}(i);
        depth = 1;
        mode = Mode::Trace;
      }
    } else if (idle == all_lanes) {
      break;
    }
    // What most paths wait for; of equals what comes first on a path.
    const int num_trace = __popc(__ballot_sync(all_lanes, mode == Mode::Trace));
    const int num_shade = __popc(__ballot_sync(all_lanes, mode == Mode::Shade));
    const int num_shadow = __popc(__ballot_sync(all_lanes, mode == Mode::Shadow));
    const Mode turn = num_trace >= num_shade && num_trace >= num_shadow ? Mode::Trace
                      : num_shade >= num_shadow                         ? Mode::Shade
                                                                        : Mode::Shadow;
    if (turn != work) ++num_switches;
    work = turn;
    if (mode != work) continue;
    bool goes_on = false;
    if (work == Mode::Trace) {
      wave.hits[i] = trace_closest<Variant::test, Variant::masks, Variant::placements>(
          Variant::accel(s), s.scene, wave.rays.rays[i]);
      mode = Mode::Shade;
    } else if (work == Mode::Shade) {
      ShadePathVertex{s.scene, p.settings, wave, depth}(i);
      has_next = !(wave.next_rays.rays[i].tmax < 0.0f);
      if (!(wave.shadows.rays[i].tmax < 0.0f)) mode = Mode::Shadow;
      else goes_on = true;
    } else {
      ++num_shadows;
      if (!trace_any<Variant::test, Variant::masks, Variant::placements>(Variant::accel(s), s.scene,
                                                                         wave.shadows.rays[i]))
        wave.paths[i].radiance += wave.shadows.contributions[i];
      goes_on = true;
    }
    if (goes_on && has_next) {
      wave.rays.rays[i] = wave.next_rays.rays[i];
      ++depth;
      ++num_bounces;
      mode = Mode::Trace;
    } else if (goes_on) {
      mode = Mode::Idle;
    }
  }
  num_bounces = warp_sum(num_bounces);
  num_shadows = warp_sum(num_shadows);
  if (lane_index() == 0) {
    if (is_persistent) add_count(&counters->ray_refills, num_refills);
    add_count(&counters->mode_switches, num_switches);
    add_count(&counters->num_bounce_rays, num_bounces);
    add_count(&counters->num_shadow_rays, num_shadows);
  }
}

template <bool Bvh, class Fn>
void dispatch_paths(const TraceScene &scene, Fn &&fn)
{
  if (scene.scene.has_alpha_masks || scene.scene.num_placements != 0)
    fn(TraceVariant<Bvh, TriangleTest::Watertight, true, true>{});
  else fn(TraceVariant<Bvh, TriangleTest::Watertight, false, false>{});
}

}  // namespace

void launch_uber_paths(const TraceScene &scene, const PathSettings &settings, const PathUnit &unit,
                       const PathWave &wave, uint32_t first, uint32_t count, RayPool pool,
                       UberPathCounters *counters, cudaStream_t stream)
{
  const Paths paths{settings, unit, wave, first, count};
  const auto start = [&]<class Variant>(Variant) {
    if (pool.num_drawn != nullptr)
      launch_persistent("uber-kernel of paths", uber_path_kernel<Variant>, count, stream, scene, paths, pool,
                        counters);
    else
      launch("uber-kernel of paths", uber_path_kernel<Variant>, count, stream, scene, paths, pool, counters);
  };
  if (scene.has_bvhs) dispatch_paths<true>(scene, start);
  else dispatch_paths<false>(scene, start);
}

}  // namespace gpurt::cuda
