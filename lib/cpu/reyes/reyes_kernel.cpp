// Runs the REYES stages one after another on the calling thread; see reyes_kernel.h.
#include "cpu/reyes/reyes_kernel.h"

#include "cpu/path/serial_executor.h"
#include "cpu/reyes/blend_loops.h"
#include "cpu/reyes/dice_grid.h"
#include "cpu/reyes/own_light.h"
#include "cpu/reyes/places.h"
#include "cpu/reyes/ray_light.h"
#include "cpu/reyes/sample_loops.h"
#include "cpu/reyes/shade_grid.h"
#include "cpu/reyes/shade_samples.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN
namespace {

// Pieces wait in a stack: each cut of both axes leaves three of four behind.
constexpr uint32_t stack_size = 3 * (parameter_bits - smallest_piece_bits) + 4;

// The box of n points in the image and around it, where samples of filters may lie, cut to the image; false: none.
bool box_of_points(const float *x, const float *y, const float *w, int n, const Camera &camera,
                   RasterBox &box)
{
  constexpr int32_t around = 3;  // a pixel more than any filter's reach
  const int32_t width = int32_t(camera.width), height = int32_t(camera.height);
  if (!raster_box(x, y, w, n, uint32_t(width + 2 * around), uint32_t(height + 2 * around), box)) return false;
  const auto cut = [](int32_t x, int32_t size) { return min(max(x - around, 0), size - 1); };
  box = {cut(box.x0, width), cut(box.y0, height), cut(box.x1, width), cut(box.y1, height)};
  return true;
}

float least_of(const float *w, int n)
{
  float least = w[0];
  for (int i = 1; i < n; ++i) least = min(least, w[i]);
  return least;
}

// Where the image shows a piece, and how near it is at the most.
struct PieceBounds {
  RasterRect box;  // raster units
  float z;         // 1 / w
};

// Of a hull before the eye, which is filled up to whole lanes, with its vertices' rounding. False: it reaches to the eye, or far
// beside the image.
bool bounds_of_hull(PieceHull &hull, RasterPoint largest, const RasterProjection &projection,
                    PieceBounds &bounds)
{
  static_assert(sizeof hull.x % sizeof(FloatLanes) == 0);
  for (; hull.n % int(num_lanes) != 0; ++hull.n) {
    hull.x[hull.n] = hull.x[0];
    hull.y[hull.n] = hull.y[0];
    hull.w[hull.n] = hull.w[0];
  }
  FloatLanes low_x = lanes(infinity), low_y = low_x, low_w = low_x, high_x = -low_x, high_y = -low_x;
  for (int i = 0; i < hull.n; i += int(num_lanes)) {
    const FloatLanes pw = load_lanes(hull.w + i), inv_w = 1.0f / pw, px = load_lanes(hull.x + i) * inv_w,
                     py = load_lanes(hull.y + i) * inv_w;
    low_x = min(low_x, px);
    low_y = min(low_y, py);
    low_w = min(low_w, pw);
    high_x = max(high_x, px);
    high_y = max(high_y, py);
  }
  float x0 = low_x[0], y0 = low_y[0], x1 = high_x[0], y1 = high_y[0], least = low_w[0];
  for (uint32_t i = 1; i < num_lanes; ++i) {
    x0 = min(x0, low_x[i]);
    y0 = min(y0, low_y[i]);
    x1 = max(x1, high_x[i]);
    y1 = max(y1, high_y[i]);
    least = min(least, low_w[i]);
  }
  const float least_w = least - raster_error * largest.w;
  if (!(least_w >= smallest_w)) return false;
  const float far = 0.5f * guard_band;
  if (!(x0 >= -far && y0 >= -far && x1 <= far && y1 <= far)) return false;
  const float margin_x = 1.0f + raster_error * (largest.x + far * largest.w) / least_w,
              margin_y = 1.0f + raster_error * (largest.y + far * largest.w) / least_w;
  const auto unit = [](float p, float centre) { return p * units_per_pixel + centre; };
  bounds.box = {unit(x0 - margin_x, projection.centre_x), unit(y0 - margin_y, projection.centre_y),
                unit(x1 + margin_x, projection.centre_x), unit(y1 + margin_y, projection.centre_y)};
  // A sample's 1 / w is a mean of its triangle's corners', of which each and the sum are rounded a few times.
  bounds.z = (1.0f / least_w) * (1.0f + 0x1p-20f);
  return true;
}

// Which of the scene's ranges a root belongs to; as range_of_root, for roots whose neighbours are looked at next.
uint32_t range_index_of_root(const ReyesScene &scene, uint64_t root)
{
  uint32_t lo = 0, hi = scene.num_ranges;
  while (hi - lo > 1) {
    const uint32_t mid = lo + (hi - lo) / 2;
    if (scene.ranges[mid].first_root <= root) lo = mid;
    else hi = mid;
  }
  return lo;
}

void bound_roots(const ReyesScene &scene, const Camera &camera, uint64_t first, uint32_t n, RasterBox *boxes,
                 float *least_w)
{
  const RasterProjection projection = raster_projection(camera);
  // Roots ascend: the first one finds its range, later ones move on.
  uint32_t r = range_index_of_root(scene, first);
  for (uint32_t i = 0; i < n; ++i) {
    const uint64_t root = first + i;
    while (scene.ranges[r + 1].first_root <= root) ++r;
    const RootRange &range = scene.ranges[r];
    const uint32_t primitive = uint32_t(root - range.first_root);
    bool is_seen;
    if (scene.patches[range.segment].num_patches != 0) {
      RasterPatch patch;
      transform_patch(scene, projection, range, primitive, patch);
      is_seen = box_of_points(patch.x, patch.y, patch.w, 16, camera, boxes[i]);
      least_w[i] = least_of(patch.w, 16);
    } else {
      RasterPoint p[3];
      transform_triangle(scene, projection, range,
                         scene.scene.segments[range.segment].first_triangle + primitive, p);
      const float x[3] = {p[0].x, p[1].x, p[2].x}, y[3] = {p[0].y, p[1].y, p[2].y},
                  w[3] = {p[0].w, p[1].w, p[2].w};
      is_seen = box_of_points(x, y, w, 3, camera, boxes[i]);
      least_w[i] = least_of(w, 3);
    }
    if (!is_seen) boxes[i] = {0, 0, -1, -1};
  }
}

// Splits, dices, shades if need be, and samples patches.
class PatchPipeline {
 public:
  // `own`: null, or what micropolygons' own light depends on. `lights_by_rays`: samples keep what of a grid they see, to be
  // lit later.
  PatchPipeline(const SceneView &scene, const RasterProjection &projection, const DiceSettings &dice,
                const OwnLight *own, bool lights_by_rays, BlockSampler &sampler, double (*seconds)(),
                ReyesKernelCounters &counters)
      : scene_(scene),
        own_(lights_by_rays ? nullptr : own),
        rays_(lights_by_rays ? own : nullptr),
        has_plain_lights_(own_ != nullptr && has_plain_lights(scene)),
        projection_(projection),
        dice_(dice),
        sampler_(sampler),
        rect_(sampler.rect()),
        seconds_(seconds),
        counters_(counters),
        last_(seconds())
  {}

  void run(const RasterPatch &patch, RasterPoint largest, uint32_t root, const Material &material)
  {
    Piece stack[stack_size];
    uint32_t waiting = 1;
    stack[0] = whole_patch();
    RasterPatch part;
    while (waiting != 0) {
      Piece piece = stack[--waiting];
      const float u0 = parameter(piece.u), u1 = parameter(piece.u + (1u << piece.u_bits));
      const float v0 = parameter(piece.v), v1 = parameter(piece.v + (1u << piece.v_bits));
      sub_patch(patch.x, u0, u1, v0, v1, part.x);
      sub_patch(patch.y, u0, u1, v0, v1, part.y);
      sub_patch(patch.w, u0, u1, v0, v1, part.w);
      PieceHull hull = hull_of_piece(patch, part, piece);
      if (!can_be_seen(hull.x, hull.y, hull.w, hull.n, largest, rect_)) {
        counters_.num_culled++;
        continue;
      }
      PieceBounds bounds;
      const bool is_bounded = bounds_of_hull(hull, largest, projection_, bounds);
      if (is_bounded && sampler_.hides(bounds.box, bounds.z)) {
        counters_.num_culled++;
        continue;
      }
      const PieceAction action = decide_piece(patch, part, dice_, piece);
      if (action == PieceAction::Dice) {
        dice(patch, piece, root, material);
        if (is_bounded) sampler_.touch(bounds.box);
        continue;
      }
      Piece parts[4];
      const uint32_t num_parts = split_piece(piece, action, parts);
      for (uint32_t i = 0; i < num_parts; ++i) stack[waiting++] = parts[i];
      counters_.num_splits += num_parts - 1;
      counters_.largest_queue = max(counters_.largest_queue, uint64_t(waiting));
    }
  }

  void charge(double &stage)
  {
    const double now = seconds_();
    stage += now - last_;
    last_ = now;
  }

 private:
  void dice(const RasterPatch &patch, const Piece &piece, uint32_t root, const Material &material)
  {
    charge(counters_.split_seconds);
    dice_grid(patch, piece, projection_, grid_);
    counters_.num_grids++;
    counters_.num_micropolygons += uint64_t(grid_.num_u) * grid_.num_v;
    charge(counters_.dice_seconds);
    if (own_ != nullptr) {
      shade_grid(scene_, has_plain_lights_, material, *own_, patch, piece, root, light_);
      counters_.num_shaded += 1u << (piece.grid_u - light_.shift_u + piece.grid_v - light_.shift_v);
      charge(counters_.path.stage_seconds[uint32_t(PathStage::Shade)]);
    }
    if (rays_ != nullptr) {
      const GridMiddles middles = middles_of(piece, rays_->block_bits);
      sampler_.sample_grid(grid_, nullptr, &middles);
    } else {
      sampler_.sample_grid(grid_, own_ != nullptr ? &light_ : nullptr);
    }
    charge(counters_.sample_seconds);
  }

  const SceneView &scene_;
  const OwnLight *const own_, *const rays_;
  const bool has_plain_lights_;
  const RasterProjection &projection_;
  const DiceSettings dice_;
  BlockSampler &sampler_;
  const RasterRect rect_;
  double (*seconds_)();
  ReyesKernelCounters &counters_;
  double last_;
  Grid grid_;
  GridLight light_;
};

// Puts the bucket's roots into the samples of the block: those that do not blend; with a sink, those that do.
void put_roots(const ReyesScene &scene, const PathSettings &settings, const ReyesSettings &reyes,
               const ReyesBucket &bucket, const SampleBlock &block, const FragmentSink *sink,
               double (*seconds)(), ReyesKernelCounters &counters)
{
  const RasterProjection projection = raster_projection(settings.camera);
  const DiceSettings dice =
      dice_settings(reyes.shading_rate, reyes.flatness, settings.camera.width, settings.camera.height);
  const bool has_own_light = reyes.shading != ReyesShading::Samples;
  BlockSampler sampler(scene, projection, block, has_own_light && !bucket.lights_by_rays, sink, bucket.wide);
  const OwnLight own =
      own_light(projection, reyes.shading == ReyesShading::Blocks ? 1 : 0, settings.max_depth >= 2);
  PatchPipeline patches(scene.scene, projection, dice, has_own_light ? &own : nullptr, bucket.lights_by_rays,
                        sampler, seconds, counters);
  uint32_t r = 0;
  for (uint64_t i = 0; i < bucket.num_roots; ++i) {
    const uint32_t root = bucket.roots != nullptr ? bucket.roots[i] : uint32_t(i);
    // Roots come in any order; many have their neighbours' range.
    if (root < scene.ranges[r].first_root || scene.ranges[r + 1].first_root <= root)
      r = range_index_of_root(scene, root);
    const RootRange &range = scene.ranges[r];
    if (scene.scene.has_blending) {
      const bool blends = scene.scene.materials[scene.scene.segments[range.segment].material].blends != 0;
      if (blends != (sink != nullptr)) continue;
    }
    const uint32_t primitive = uint32_t(root - range.first_root);
    if (scene.patches[range.segment].num_patches != 0) {
      RasterPatch patch;
      transform_patch(scene, projection, range, primitive, patch);
      if (is_behind(patch.w, 16)) continue;
      const RasterPoint largest = largest_coordinates(patch.x, patch.y, patch.w, 16);
      sampler.begin_root(root, largest);
      counters.num_patches++;
      patches.run(patch, largest, root, scene.scene.materials[scene.scene.segments[range.segment].material]);
    } else {
      RasterPoint p[3];
      transform_triangle(scene, projection, range,
                         scene.scene.segments[range.segment].first_triangle + primitive, p);
      const float x[3] = {p[0].x, p[1].x, p[2].x}, y[3] = {p[0].y, p[1].y, p[2].y},
                  w[3] = {p[0].w, p[1].w, p[2].w};
      sampler.begin_root(root, largest_coordinates(x, y, w, 3));
      counters.num_triangles++;
      sampler.sample_triangle(raster_vertex(p[0], 0.0f, 0.0f, projection),
                              raster_vertex(p[1], 1.0f, 0.0f, projection),
                              raster_vertex(p[2], 0.0f, 1.0f, projection));
    }
  }
  patches.charge(counters.split_seconds);
  counters.num_fragments += sampler.num_fragments();
}

SampleBlock find_nearest(const ReyesScene &scene, const PathSettings &settings, const ReyesSettings &reyes,
                         const ReyesBucket &bucket, const ReyesMemory &memory, double (*seconds)(),
                         ReyesKernelCounters &counters)
{
  const double start = seconds();
  const Places places(settings, reyes, bucket, memory);
  counters.path.stage_seconds[uint32_t(PathStage::Generate)] += seconds() - start;
  put_roots(scene, settings, reyes, bucket, places.block(), nullptr, seconds, counters);
  return places.block();
}

void find_visible(const ReyesScene &scene, const PathSettings &settings, const ReyesSettings &reyes,
                  const ReyesBucket &bucket, const ReyesMemory &memory, double (*seconds)(),
                  ReyesKernelCounters &counters)
{
  find_nearest(scene, settings, reyes, bucket, memory, seconds, counters);
}

// Path tracing's stages with what the samples see in place of the eye rays' hits.
class ReyesExecutor : public SerialExecutor {
 public:
  ReyesExecutor(const CpuAccel &accel, const ReyesScene &scene, const PathSettings &settings,
                const ReyesSettings &reyes, const ReyesMemory &memory, const PathUnit &unit,
                const PathWave &wave, bool has_found_light, double (*seconds)(),
                ReyesKernelCounters &counters)
      : SerialExecutor(accel, seconds, counters.path),
        scene_(scene),
        settings_(settings),
        reyes_(reyes),
        memory_(memory),
        unit_(unit),
        wave_(wave),
        has_found_light_(has_found_light),
        num_shaded_(counters.num_shaded)
  {}

  void trace_closest(const Ray *rays, Hit *hits, uint32_t n)
  {
    if (!is_first_trace_) {
      SerialExecutor::trace_closest(rays, hits, n);
      return;
    }
    look_up(n);
    is_first_trace_ = false;
    charge(PathStage::Trace);
  }

  void trace_occluded(const Ray *rays, uint8_t *occluded, uint32_t n)
  {
    if (!reyes_.no_shadows) {
      SerialExecutor::trace_occluded(rays, occluded, n);
      return;
    }
    for (uint32_t i = 0; i < n; ++i) occluded[i] = 0;
    charge(PathStage::Shadow);
  }

  // The last rays of direct light look for lamps and the environment alone.
  uint32_t compact_rays(const RayQueue &from, uint32_t n, const RayQueue &to)
  {
    return has_found_light_ ? SerialExecutor::compact_rays(from, n, to) : 0;
  }

 private:
  void look_up(uint32_t n)
  {
    for (uint32_t i = 0; i < n; ++i) {
      const uint32_t k = uint32_t(unit_.first_path) + i, slot = memory_.slot[k];
      Ray &ray = wave_.rays.rays[i];
      if (reyes_.filter != ReyesFilter::Box) {
        const PathSample s = path_sample(unit_, i);
        ray = ray_of_sample(settings_.camera, memory_, s, k);
        wave_.paths[i].throughput = vec3(memory_.weight[k]);
      }
      const uint32_t root = memory_.root[slot];
      wave_.hits[i] = hit_of_sample(scene_, settings_.camera, ray, root, memory_.z[slot],
                                    {memory_.u[slot], memory_.v[slot]});
      num_shaded_ += root != invalid_id;
    }
  }

  const ReyesScene &scene_;
  const PathSettings &settings_;
  const ReyesSettings &reyes_;
  const ReyesMemory &memory_;
  const PathUnit &unit_;
  const PathWave &wave_;
  const bool has_found_light_;
  uint64_t &num_shaded_;
};

void shade(const CpuAccel &accel, const ReyesScene &scene, const PathSettings &settings,
           const ReyesSettings &reyes, const ReyesBucket &bucket, const ReyesMemory &memory,
           const PointMemory &points, const PathWave &wave, uint32_t wave_capacity, const FilmView &film,
           double (*seconds)(), ReyesKernelCounters &counters)
{
  if (bucket.lights_by_rays) {
    RayLight(accel, scene, settings, reyes, bucket, memory, points, wave, wave_capacity, seconds, counters)
        .run(film, counters);
    return;
  }
  if (reyes.shading != ReyesShading::Samples) {
    const double start = seconds();
    resolve_own_light(reyes, bucket, memory, film, counters);
    counters.path.stage_seconds[uint32_t(PathStage::Film)] += seconds() - start;
    return;
  }
  if (reyes.no_shadows && !bucket.has_found_light) {
    const double start = seconds();
    shade_samples(scene, settings, bucket, memory, film, counters);
    counters.path.stage_seconds[uint32_t(PathStage::Shade)] += seconds() - start;
    return;
  }
  const uint64_t num_paths = uint64_t(bucket.x1 - bucket.x0) * (bucket.y1 - bucket.y0) * bucket.num_samples;
  for (uint64_t first = 0; first < num_paths; first += wave_capacity) {
    const PathUnit unit{bucket.x0, bucket.y0, bucket.x1, bucket.y1, bucket.first_sample, first};
    const uint32_t n = uint32_t(min(uint64_t(wave_capacity), num_paths - first));
    ReyesExecutor executor(accel, scene, settings, reyes, memory, unit, wave, bucket.has_found_light, seconds,
                           counters);
    trace_paths(executor, scene.scene, settings, unit, wave, film, n);
    for (uint32_t i = 0; i < n; ++i) {
      const float largest = max_component(wave.paths[i].radiance);
      if (largest > counters.path.largest_sample) counters.path.largest_sample = largest;
    }
  }
}

void blend(const CpuAccel &accel, const ReyesScene &scene, const PathSettings &settings,
           const ReyesSettings &reyes, const ReyesBucket &bucket, const ReyesMemory &memory,
           const BlendMemory &blend_memory, const PathWave &wave, uint32_t wave_capacity,
           const FilmView &film, double (*seconds)(), ReyesKernelCounters &counters)
{
  SampleBlock block{};
  const auto find = [&](const ReyesBucket &part, const FragmentSink *sink) {
    if (sink == nullptr) block = find_nearest(scene, settings, reyes, part, memory, seconds, counters);
    else put_roots(scene, settings, reyes, part, block, sink, seconds, counters);
  };
  BlendedBucket(accel, scene, settings, reyes, memory, blend_memory, wave, wave_capacity, film, bucket.x0,
                bucket.y0, seconds, counters, find)
      .run(bucket);
}

}  // namespace

const ReyesKernels &reyes_kernels()
{
  static constexpr ReyesKernels kernels = {bound_roots, find_visible, shade, blend};
  return kernels;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
