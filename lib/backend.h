// What a backend is to the rest of the library: it commits scenes, traces rays and renders work units.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/accel/kd_tree.h"
#include "core/accel/ray.h"
#include "core/path/path_settings.h"
#include "core/photon/photon.h"
#include "core/reyes/reyes_scene.h"
#include "frame/film.h"
#include "memory.h"
#include "photon_pass.h"
#include "scene/compiled_scene.h"
#include "schedule.h"

namespace gpurt {

enum class Accel : uint32_t { Auto = 0, KdTree = 1, Embree = 2, Bvh = 3 };  // values of gpurt_accel

/// What the command line and files call it.
inline const char *accel_name(Accel accel)
{
  switch (accel) {
    case Accel::KdTree:
      return "kdtree";
    case Accel::Embree:
      return "embree";
    case Accel::Bvh:
      return "bvh";
    default:
      return "auto";
  }
}

enum class BuildQuality : uint32_t { Auto = 0, Fast = 1, High = 2 };  // values of gpurt_build_quality

/// A kd-tree handed in or out by the tree exchange. Tree 0 is group 0; 1 + g is the group of shared geometry g.
struct HostKdTree {
  std::vector<KdNode> nodes;
  std::vector<uint32_t> references;  // triangles, counted from the group's first
  Box bounds;
  uint64_t num_triangles = 0;
};

class CommittedScene;

struct BuildOptions {
  Accel accel = Accel::Auto;
  TriangleTest triangle_test = TriangleTest::Watertight;
  BuildQuality quality = BuildQuality::Auto;
  uint32_t max_depth = 0;    // 0: 8 + 1.3 log2 N
  float traversal_cost = 0;  // 0: the builder's choice
  float empty_bonus = 0;     // 0: the builder's choice
  std::string cache_path;    // "": none
  std::vector<std::pair<uint32_t, std::shared_ptr<const HostKdTree>>>
      imported;  // (tree, nodes) to use in place of building
  // A commit of the same triangles, whose vertices may have moved since: its trees may be refitted. Null: none.
  std::shared_ptr<const CommittedScene> previous;
};

/// What a commit built, for gpurt_scene_facts.
struct AccelFacts {
  Accel accel = Accel::Auto;  // resolved
  std::string reason;         // why, where the backend resolved it; else empty
  TriangleTest triangle_test = TriangleTest::Watertight;
  uint64_t accel_bytes = 0;
  uint64_t num_nodes = 0;
  uint64_t num_references = 0;
  uint32_t tree_depth = 0;
  bool from_cache = false;
  double sah_cost = 0;
  double build_seconds = 0;
  uint64_t build_peak_bytes = 0;  // 0: not built on a device
  bool is_refitted = false;
};

/// SceneView::t_error of an accelerator. A t of single precision is off by some ten roundings of the distances from the
/// point to the triangle's corners: of the corners' differences, the normal, two dot products and the quotient.
inline float t_error(const AccelFacts &facts)
{
  const bool is_single = facts.accel == Accel::Embree || facts.triangle_test == TriangleTest::MollerTrumbore;
  return is_single ? error_gamma(20) : 0.0f;
}

enum class QueryKind : uint32_t { Closest = 0, Any = 1, All = 2 };

enum class Coherence : uint32_t { Auto = 0, Coherent = 1, Incoherent = 2 };  // values of gpurt_coherence

/// gpurt_trace_desc after validation.
struct TraceRequest {
  QueryKind query = QueryKind::Closest;
  bool compact = false;
  bool device_memory = false;
  uint64_t num_rays = 0;
  const Ray *rays = nullptr;
  void *hits = nullptr;
  uint8_t *occluded = nullptr;
  uint64_t *offsets = nullptr;
  uint64_t hit_capacity = 0;
  Schedule schedule;
  ScheduleCounters *counters = nullptr;  // null: not wanted
  Coherence coherence = Coherence::Auto;
  uint32_t image_width = 0;
  bool count_lanes = false;  // of warps that work, into counters; closest hits alone
};

/// A rectangle of pixels and the sample indices to take in each of them.
struct WorkUnit {
  uint32_t x0, y0, x1, y1;
  uint64_t first_sample, num_samples;
};

/// gpurt_reyes_counters, without what is reserved. Times are summed over threads.
struct ReyesCounters {
  uint64_t num_patches = 0, num_triangles = 0, num_splits = 0, num_culled = 0, num_grids = 0,
           num_micropolygons = 0, num_fragments = 0, num_shaded = 0;
  uint64_t largest_queue = 0, largest_bucket = 0, working_bytes = 0;
  double bound_seconds = 0, split_seconds = 0, dice_seconds = 0, sample_seconds = 0;
  uint64_t split_rounds = 0, num_donated = 0;
  uint64_t largest_fragments = 0, num_lost_fragments = 0;

  void add(const ReyesCounters &other);
};

/// Times are summed over threads.
struct RenderCounters {
  uint64_t num_samples = 0, num_camera_rays = 0, num_bounce_rays = 0, num_shadow_rays = 0, num_nonfinite = 0;
  double generate_seconds = 0, trace_seconds = 0, shade_seconds = 0, shadow_seconds = 0, film_seconds = 0;
  float largest_sample = 0;
  ScheduleCounters schedule;
  PhotonCounters photon;
  ReyesCounters reyes;
};

/// What passes of photon mapping need beside a path tracer's settings.
struct PhotonRequest {
  PhotonSettings settings;
  EmissionView emission;  // in host memory
};

/// A few photons and points that see them, from which the initial radius follows.
struct PhotonPilot {
  struct Point {
    Vec3f position;
    uint32_t normal_code;
  };
  std::vector<Point> points;
  uint64_t num_photons = 0;
};

/// Takes some of a pilot's photons, and all of its points, which come with every call.
using TakePilotPhotons =
    std::function<void(std::span<const PhotonPilot::Point> points, std::span<const Photon> photons)>;

/// What adding samples to a film found: samples that had been left out, and sums beyond the range in which more are safe.
struct FilmFinds {
  uint64_t num_nonfinite = 0, num_saturated = 0;
};

/// A film's sums in the memory of a device, to which its passes add without the host. The memory is taken when it is first
/// needed, and counted as the frame's film, which is reserved already. From one thread at a time.
class DeviceFilm {
 public:
  virtual ~DeviceFilm() = default;
  /// Takes the host's sums over. Throws OUT_OF_MEMORY, DEVICE.
  virtual void upload(const TileFilm &from) = 0;
  /// Puts its sums in the place of the host's, which have the same size and outputs. Throws DEVICE; `has_begun` then says whether
  /// some of the host's are overwritten.
  virtual void download(TileFilm &to, bool &has_begun) const = 0;
  /// Writes an output of all pixels as resolve_row() does; `data` is memory of the host or of this device. False, with nothing
  /// written: it is one that the host resolves. Throws DEVICE.
  virtual bool resolve(gpurt_output output, void *data, uint64_t bytes) const = 0;
};

/// A frame whose sums are on the device that renders.
struct FilmOnDevice {
  DeviceFilm *film;
  /// Takes finished units in place of RenderPass::deliver, whole or not at all: it calls `add`, which adds them to the film,
  /// while nobody else looks at that. From any thread.
  std::function<void(std::span<const WorkUnit>, const RenderCounters &,
                     const std::function<FilmFinds()> &add)>
      deliver;
};

/// One pass: units in any order, on all workers of the backend.
struct RenderPass {
  PathSettings settings;
  uint32_t outputs = 0;  // what the film has arrays for: bits of TileFilm::outputs
  std::span<const WorkUnit> units;
  // Photon mapping: every sample of a unit is a pass, and there are no more than most_photon_passes(). Null: path tracing.
  const PhotonRequest *photon = nullptr;
  // Photon mapping with a memory: what each pixel of the frame has, row by row, as its last delivered unit left it. Else null.
  const PixelStatistics *statistics = nullptr;
  const ReyesSettings *reyes = nullptr;          // REYES: resolved settings; null: another pipeline
  Schedule schedule;                             // resolved; REYES: of its rays
  ReyesSchedule reyes_schedule;                  // REYES: resolved
  const std::atomic<bool> *cancelled = nullptr;  // once true, units that have not started are left out
  /// Where several devices share a pass: the next units for this one, none once all are taken. A backend that calls it when
  /// it runs out of units keeps its device busy; one that does not is called again. From any thread. May be null.
  std::function<std::span<const WorkUnit>()> more;
  /// Takes the finished samples of a unit; called from any thread. A unit is delivered whole or not at all.
  std::function<void(const WorkUnit &, const TileFilm &, const RenderCounters &)> deliver;
  const FilmOnDevice *on_device = nullptr;  // of this device; null: units are delivered to the host
};

class PhotonMap;  // photon_maps.h
struct ScenePhotonRequest;

/// An immutable scene, ready to trace. Used from any thread.
class CommittedScene {
 public:
  virtual ~CommittedScene() = default;
  virtual const AccelFacts &accel_facts() const = 0;
  virtual void trace(const TraceRequest &request) const = 0;
  virtual void render(const RenderPass &pass) const = 0;
  /// A film without samples in the device's memory, which keeps the device; null where passes deliver to the host alone.
  virtual std::unique_ptr<DeviceFilm> make_film(uint32_t /*width*/, uint32_t /*height*/,
                                                uint32_t /*outputs*/) const
  {
    return nullptr;
  }
  /// Throws UNSUPPORTED where the device has no photon mapping.
  virtual void require_photons() const;
  /// Throws UNSUPPORTED where photon mapping cannot keep statistics of pixels from pass to pass.
  virtual void require_photon_statistics() const;
  /// Samples that units of photon mapping may have.
  virtual uint64_t most_photon_passes() const { return 1; }
  /// Finds the visible points of pixels in points_per_axis^2 places of the image, and traces num_paths photon paths, whose
  /// photons come in parts, in any order, so that memory need not hold them all. The same points and photons on every
  /// device. Throws UNSUPPORTED, OUT_OF_MEMORY.
  virtual PhotonPilot photon_pilot(const PathSettings &settings, const EmissionView &emission,
                                   uint32_t num_paths, uint32_t points_per_axis,
                                   const TakePilotPhotons &take) const;
  /// A map of the photons of a pass on the scene's device, sorted by (path, bounce); of `settings` the seed, the frame and
  /// the depth count. The same photons on every device. Throws UNSUPPORTED, OUT_OF_MEMORY.
  virtual std::shared_ptr<const PhotonMap> photon_map(const PathSettings &settings,
                                                      const EmissionView &emission,
                                                      const ScenePhotonRequest &request) const;
  /// Throws UNSUPPORTED where the device has no REYES.
  virtual void require_reyes() const;
  /// How REYES cuts patches and goes through its stages, with values for what was left to the library. Throws UNSUPPORTED.
  virtual ReyesSchedule resolve_reyes_schedule(const Schedule &asked, const ReyesSettings &settings) const;
  /// Throws INVALID_ARGUMENT where there is no such kd-tree.
  virtual HostKdTree export_tree(uint32_t tree) const = 0;
  /// The schedule with values for what was left to the library. Throws UNSUPPORTED naming what is not there.
  virtual Schedule resolve_schedule(const Schedule &asked, ScheduleUse) const
  {
    return resolve_fused_schedule(asked, "this device");
  }
};

inline void CommittedScene::require_photons() const
{
  fail(GPURT_ERROR_UNSUPPORTED,
       "GPURT_PIPELINE_PHOTON is not supported by this device; use a CPU or CUDA device, or "
       "GPURT_PIPELINE_PATH "
       "with more samples per pixel where caustics matter");
}

inline void CommittedScene::require_photon_statistics() const
{
  fail(GPURT_ERROR_UNSUPPORTED,
       "photon.estimator is not supported by this device: it keeps statistics of pixels from pass to pass; "
       "use "
       "GPURT_PHOTON_ESTIMATOR_MEMORYLESS");
}

inline PhotonPilot CommittedScene::photon_pilot(const PathSettings &, const EmissionView &, uint32_t,
                                                uint32_t, const TakePilotPhotons &) const
{
  require_photons();
  return {};
}

inline std::shared_ptr<const PhotonMap> CommittedScene::photon_map(const PathSettings &, const EmissionView &,
                                                                   const ScenePhotonRequest &) const
{
  require_photons();
  return nullptr;
}

inline void CommittedScene::require_reyes() const
{
  fail(GPURT_ERROR_UNSUPPORTED,
       "GPURT_PIPELINE_REYES is not supported by this device; use GPURT_PIPELINE_PATH with max_depth 2 for "
       "direct "
       "light alone");
}

inline ReyesSchedule CommittedScene::resolve_reyes_schedule(const Schedule &asked,
                                                            const ReyesSettings &) const
{
  if ((asked.launch != Launch::Auto && asked.launch != Launch::Regular) ||
      (asked.traversal != Traversal::Auto && asked.traversal != Traversal::Stack)) {
    fail(GPURT_ERROR_UNSUPPORTED,
         "schedule.launch is {} and schedule.traversal {}, which schedule kernels of CUDA devices; this "
         "device cuts, "
         "dices and samples patch by patch: leave both AUTO",
         uint32_t(asked.launch), uint32_t(asked.traversal));
  }
  return {Launch::Regular, Traversal::Stack};
}

/// What a committed scene may offer beside CommittedScene: queries that are queued on the caller's stream. The handles are
/// those of gpurt_cuda.h; null: none.
class StreamTracing {
 public:
  virtual ~StreamTracing() = default;
  /// Queues the request, whose memory is the device's, and returns; the committed scene outlives the work.
  virtual void trace_on_stream(const TraceRequest &request, void *stream, void *wait_event,
                               void *done_event) const = 0;
};

/// A kernel of a CUDA device, for gpurt_cuda_kernel.
struct KernelInfo {
  std::string name;
  uint64_t num_launches = 0;
  uint32_t block_threads = 0, registers = 0, local_bytes = 0, shared_bytes = 0, blocks_per_multiprocessor = 0;
  float occupancy = 0;
};

/// What a backend may offer beside Backend: the kernels that were launched.
class KernelListing {
 public:
  virtual ~KernelListing() = default;
  virtual std::vector<KernelInfo> kernels() const = 0;
};

struct DeviceInfo {
  gpurt_device_type type = GPURT_DEVICE_CPU;
  uint32_t ordinal = 0;
  uint32_t num_threads = 0;
  uint64_t memory_bytes = 0;
  uint32_t compute_capability = 0;
  std::string name, instruction_set;
};

/// A device in use. Used from any thread.
class Backend {
 public:
  virtual ~Backend() = default;
  virtual const DeviceInfo &info() const = 0;
  virtual const std::shared_ptr<MemoryTracker> &memory() const = 0;
  virtual std::shared_ptr<const CommittedScene> commit(std::shared_ptr<const CompiledScene> scene,
                                                       const BuildOptions &options) = 0;
  /// Device memory that the host cannot reach, filled with zeros; the deleter frees it, after the work that is on the
  /// device's default stream then. On the CPU: host memory.
  virtual std::shared_ptr<void> allocate(uint64_t bytes) = 0;
  virtual void copy_to_host(void *host, const void *device, uint64_t bytes) = 0;
  virtual void copy_to_device(void *device, const void *host, uint64_t bytes) = 0;
  /// Whether memory is the device's own. On the CPU: any is.
  virtual bool holds(const void *data) const = 0;
};

/// What a backend may offer beside Backend: the caller's streams, as handles of gpurt_cuda.h; null: the default stream.
class StreamOrdering {
 public:
  virtual ~StreamOrdering() = default;
  /// Later work of `stream` waits for what is on `after` now. Throws INVALID_ARGUMENT for another device's ordinal.
  virtual void order_streams(uint32_t ordinal, void *stream, void *after) = 0;
  virtual void wait_for_stream(uint32_t ordinal, void *stream) = 0;
};

struct BackendOptions {
  uint32_t ordinal = 0;
  uint32_t num_threads = 0;
  uint64_t memory_limit_bytes = 0;
  std::function<void(gpurt_log_level, const std::string &)> log;  // may be called from any thread
};

/// One way to make devices; the registry in lib/api lists them.
struct BackendFactory {
  gpurt_device_type type;
  std::vector<DeviceInfo> (*enumerate)();  // never throws for want of a driver
  std::unique_ptr<Backend> (*create)(const BackendOptions &options);
};

}  // namespace gpurt
