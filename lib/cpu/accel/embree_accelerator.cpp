// Embree behind the accelerator interface. It promises neither our bits nor that no ray passes between triangles: ids at
// shared edges and at equal distances come as Embree finds them, and rays through vertices may leak (docs/stability.md).
#include <tbb/task_group.h>

#include <algorithm>
#include <cstring>
#include <mutex>

#include "accel/tracked_array.h"
#include "core/accel/trace.h"
#include "cpu/accel/accelerator.h"
#include "cpu/accel/embree_api.h"

namespace gpurt {
namespace {

struct ReleaseDevice {
  void operator()(RTCDevice d) const { rtcReleaseDevice(d); }
};
struct ReleaseScene {
  void operator()(RTCScene s) const { rtcReleaseScene(s); }
};
struct ReleaseGeometry {
  void operator()(RTCGeometry g) const { rtcReleaseGeometry(g); }
};
using Device = std::unique_ptr<RTCDeviceTy, ReleaseDevice>;
using Scene = std::unique_ptr<RTCSceneTy, ReleaseScene>;
using Geometry = std::unique_ptr<RTCGeometryTy, ReleaseGeometry>;

// Consecutive triangles of a group that are all opaque or all masked: one Embree geometry, whose ids count from 0.
struct Run {
  const SceneView *scene;  // for the filter
  uint32_t first_triangle;
  uint32_t num_triangles;
  bool is_masked;
};

// What CpuAccel::impl points to.
struct EmbreeView {
  RTCScene scene;
  SceneView view;
  // By geometry id: first the runs of group 0, then the placements.
  const uint32_t *world_runs;  // first triangles
  uint32_t num_world_runs;
  const uint32_t *const *group_runs;  // [group]: first triangles of its runs
};

Hit hit_from(const EmbreeView &v, const RTCHit &hit, float t)
{
  if (hit.geomID == RTC_INVALID_GEOMETRY_ID) return {t, 0.0f, 0.0f, invalid_id, invalid_id};
  if (hit.instID[0] == RTC_INVALID_GEOMETRY_ID) {
    return {t, hit.u, hit.v, v.world_runs[hit.geomID] + hit.primID, invalid_id};
  }
  const uint32_t placement = hit.instID[0] - v.num_world_runs;
  return {t, hit.u, hit.v, v.group_runs[v.view.placements[placement].group][hit.geomID] + hit.primID,
          placement};
}

// Embree wants tnear >= 0: a ray that begins behind its origin is moved there. Returns how far.
float move_origin(const EmbreeView &v, TraceRay &ray)
{
  if (ray.tmin >= 0.0f) return 0.0f;
  // Not further than the scene reaches: tmin may be infinite.
  const Vec3f below = v.view.bounds.lo - ray.origin, above = v.view.bounds.hi - ray.origin;
  const float reach = max(max_component(abs(below)), max_component(abs(above)));
  const float t = max(ray.tmin, -2.0f * reach / abs(at(ray.direction, ray.main_axis)));
  ray.origin = ray.origin + ray.direction * t;
  ray.tmin = ray.tmin == t ? 0.0f : max(ray.tmin - t, 0.0f);
  ray.tmax = ray.tmax - t;
  return t;
}

typedef float Floats __attribute__((vector_size(16)));

// Origin, tmin, direction and tmax of a Ray or a TraceRay. Embree reads an origin with tnear and a direction as one
// vector each: written as such, they need not wait for each other. Adding +0 turns -0 into +0 (prepare_ray).
template <class AnyRay>
void set_ray(const AnyRay &r, RTCRay &ray)
{
  static_assert(offsetof(AnyRay, tmin) == 12 && offsetof(AnyRay, direction) == 16 &&
                offsetof(AnyRay, tmax) == 28);
  static_assert(offsetof(RTCRay, tnear) == 12 && offsetof(RTCRay, dir_x) == 16 &&
                offsetof(RTCRay, time) == 28);
  Floats half[2];
  std::memcpy(half, &r, sizeof half);
  half[0] += 0.0f;
  half[1] += 0.0f;
  half[1][3] = 0.0f;  // time
  std::memcpy(&ray, half, sizeof half);
  ray.tfar = r.tmax;
  ray.mask = 0xffffffffu;
  ray.id = 0;
  ray.flags = 0;
}

// Nearly every ray: finite, of a direction that needs no scaling, ahead of its origin. A sum is not finite, or NaN, if a
// term is.
bool is_plain(const Ray &r)
{
  const float direction = abs(r.direction.x) + abs(r.direction.y) + abs(r.direction.z);
  const float origin = abs(r.origin.x) + abs(r.origin.y) + abs(r.origin.z);
  return direction >= 0x1p-40f && direction <= 0x1p40f && origin < infinity && r.tmin >= 0.0f &&
         r.tmin <= r.tmax;
}

// Another ray as Embree can take it, and how far its origin was moved; false: it misses everything.
bool prepare_for_embree(const EmbreeView &v, const Ray &ray, TraceRay &r, float &moved)
{
  if (!prepare_ray(ray.origin, ray.direction, ray.tmin, ray.tmax, r)) return false;
  moved = move_origin(v, r);
  return true;
}

void closest(const CpuAccel &accel, const Ray *rays, Hit *hits, uint32_t n)
{
  const EmbreeView &v = *static_cast<const EmbreeView *>(accel.impl);
  for (uint32_t i = 0; i < n; ++i) {
    const Ray &ray = rays[i];
    RTCRayHit query;
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    if (is_plain(ray)) {
      set_ray(ray, query.ray);
      embree::intersect(v.scene, query);
      hits[i] = hit_from(v, query.hit, query.ray.tfar);
      continue;
    }
    hits[i] = {ray.tmax, 0.0f, 0.0f, invalid_id, invalid_id};
    TraceRay r;
    float moved;
    if (!prepare_for_embree(v, ray, r, moved)) continue;
    set_ray(r, query.ray);
    embree::intersect(v.scene, query);
    if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) continue;
    hits[i] = hit_from(v, query.hit, caller_t(r, query.ray.tfar + moved));
  }
}

void occluded(const CpuAccel &accel, const Ray *rays, uint8_t *occluded, uint32_t n)
{
  const EmbreeView &v = *static_cast<const EmbreeView *>(accel.impl);
  for (uint32_t i = 0; i < n; ++i) {
    const Ray &ray = rays[i];
    RTCRay query;
    if (is_plain(ray)) {
      set_ray(ray, query);
    } else {
      TraceRay r;
      float moved;
      occluded[i] = 0;
      if (!prepare_for_embree(v, ray, r, moved)) continue;
      set_ray(r, query);
    }
    embree::occluded(v.scene, query);
    occluded[i] = query.tfar < 0.0f;
  }
}

// Rejects hits in the holes of alpha masks and those by chance of materials that blend. Through a shared geometry the ray
// is in object space: a placement has its own.
void filter_holes(const RTCFilterFunctionNArguments *args)
{
  const Run &run = *static_cast<const Run *>(args->geometryUserPtr);
  for (unsigned i = 0; i < args->N; ++i) {
    if (args->valid[i] == 0) continue;
    const uint32_t primitive = RTCHitN_primID(args->hit, args->N, i);
    const float u = RTCHitN_u(args->hit, args->N, i), v = RTCHitN_v(args->hit, args->N, i);
    const TraceRay ray = {
        {RTCRayN_org_x(args->ray, args->N, i) + 0.0f, RTCRayN_org_y(args->ray, args->N, i) + 0.0f,
         RTCRayN_org_z(args->ray, args->N, i) + 0.0f},
        0,
        {RTCRayN_dir_x(args->ray, args->N, i) + 0.0f, RTCRayN_dir_y(args->ray, args->N, i) + 0.0f,
         RTCRayN_dir_z(args->ray, args->N, i) + 0.0f},
        0,
        0,
        0};
    if (lets_pass(*run.scene, ray_key(ray), run.first_triangle + primitive, invalid_id, u, v))
      args->valid[i] = 0;
  }
}

// Collects crossings. A ray through an edge meets one or both of its triangles, as Embree's test sees it.
struct AllQuery : embree::FilteredQuery {
  const EmbreeView *view;
  const TraceRay *ray;
  float moved;
  void *user;
  void (*sink)(void *, const Hit &);
};

void filter_all(const RTCFilterFunctionNArguments *args)
{
  const auto &query = *reinterpret_cast<const AllQuery *>(args->context);
  for (unsigned i = 0; i < args->N; ++i) {
    if (args->valid[i] == 0) continue;
    RTCHit hit;
    hit.geomID = RTCHitN_geomID(args->hit, args->N, i);
    hit.primID = RTCHitN_primID(args->hit, args->N, i);
    hit.instID[0] = RTCHitN_instID(args->hit, args->N, i, 0);
    hit.u = RTCHitN_u(args->hit, args->N, i);
    hit.v = RTCHitN_v(args->hit, args->N, i);
    const float t = RTCRayN_tfar(args->ray, args->N, i) + query.moved;
    query.sink(query.user, hit_from(*query.view, hit, caller_t(*query.ray, t)));
    args->valid[i] = 0;  // on to the next one
  }
}

class EmbreeAccelerator final : public Accelerator {
 public:
  EmbreeAccelerator(const AccelContext &context, const BuildOptions &options)
      : scene_(context.scene), memory_(context.memory), view_(scene_->view())
  {
    if (options.triangle_test == TriangleTest::Double) {
      fail(GPURT_ERROR_UNSUPPORTED,
           "Embree has no triangle test in double precision; use the kdtree accelerator");
    }
    facts_.accel = Accel::Embree;
    facts_.triangle_test = options.triangle_test;
    is_robust_ = options.triangle_test == TriangleTest::Watertight;
    device_.reset(rtcNewDevice(fmt::format("threads={},set_affinity=0", context.num_threads).c_str()));
    if (!device_)
      fail(GPURT_ERROR_DEVICE, "Embree cannot be initialised (error {})", int(rtcGetDeviceError(nullptr)));
    rtcSetDeviceMemoryMonitorFunction(device_.get(), monitor_memory, this);
    try {
      build();
    } catch (...) {
      release();
      throw;
    }
    facts_.accel_bytes = uint64_t(std::max<int64_t>(used_bytes_, 0));
  }

  ~EmbreeAccelerator() override { release(); }

  const CpuAccel &queries() const override { return queries_; }
  const AccelFacts &facts() const override { return facts_; }

  void all(const Ray &ray, void *user, void (*sink)(void *, const Hit &)) const override
  {
    TraceRay r;
    AllQuery query;
    if (!prepare_for_embree(embree_view_, ray, r, query.moved)) return;
    query.view = &embree_view_;
    query.ray = &r;
    query.user = user;
    query.sink = sink;
    RTCRayHit ray_hit;
    set_ray(r, ray_hit.ray);
    ray_hit.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    ray_hit.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    embree::intersect(embree_view_.scene, ray_hit, query, filter_all);
  }

  HostKdTree export_tree(uint32_t) const override
  {
    fail_invalid(
        "the scene was committed with Embree, which has no kd-tree to export; commit with the kdtree "
        "accelerator");
  }

 private:
  void build()
  {
    const size_t num_groups = scene_->groups.size();
    runs_.resize(num_groups);
    first_triangles_.resize(num_groups);
    for (size_t g = 0; g < num_groups; ++g) {
      runs_[g] = make_runs(scene_->groups[g]);
      for (const Run &run : runs_[g]) first_triangles_[g].push_back(run.first_triangle);
      group_runs_.push_back(first_triangles_[g].data());
    }
    // The last vertex is read as 16 bytes: without memory behind it, the positions are copied.
    if (!scene_->positions.empty() && scene_->positions.capacity() == scene_->positions.size()) {
      copied_positions_ = TrackedArray<Vec3f>(memory_, scene_->positions.size() + 1, "Embree's vertices");
      std::copy(scene_->positions.begin(), scene_->positions.end(), copied_positions_.data());
      copied_positions_[scene_->positions.size()] = {0, 0, 0};
    }

    Scene top = new_scene();
    attach_runs(top.get(), runs_[0]);
    for (size_t p = 0; p < scene_->placements.size(); ++p) {
      const Placement &placement = scene_->placements[p];
      const uint32_t g = placement.group;
      if (scene_->groups[g].num_triangles == 0) continue;
      if (shared_.size() <= g) shared_.resize(num_groups);
      if (!shared_[g]) {
        shared_[g] = new_scene();
        attach_runs(shared_[g].get(), runs_[g]);
        commit(shared_[g].get());
      }
      Geometry instance(rtcNewGeometry(device_.get(), RTC_GEOMETRY_TYPE_INSTANCE));
      rtcSetGeometryInstancedScene(instance.get(), shared_[g].get());
      rtcSetGeometryTransform(instance.get(), 0, RTC_FORMAT_FLOAT3X4_ROW_MAJOR,
                              &placement.object_to_world.m[0][0]);
      rtcCommitGeometry(instance.get());
      rtcAttachGeometryByID(top.get(), instance.get(), uint32_t(runs_[0].size() + p));
    }
    commit(top.get());
    top_ = std::move(top);

    embree_view_ = {top_.get(), view_, first_triangles_[0].data(), uint32_t(runs_[0].size()),
                    group_runs_.data()};
    queries_ = {&embree_view_, closest, occluded};
  }

  // Scenes before their device: the monitor is called while they give their memory back.
  void release()
  {
    top_.reset();
    shared_.clear();
    device_.reset();
  }

  std::vector<Run> make_runs(const Group &group) const
  {
    std::vector<Run> runs;
    const uint64_t end = uint64_t(group.first_triangle) + group.num_triangles;
    for (uint64_t t = group.first_triangle; t < end;) {
      const Segment &segment = scene_->segments[scene_->triangle_segment[t]];
      const Material &material = scene_->materials[segment.material];
      const bool is_masked = material.alpha_cutoff > 0.0f || material.blends != 0;
      const uint64_t next = std::min(uint64_t(segment.first_triangle) + segment.num_triangles, end);
      if (runs.empty() || runs.back().is_masked != is_masked)
        runs.push_back({&view_, uint32_t(t), 0, is_masked});
      runs.back().num_triangles += uint32_t(next - t);
      t = next;
    }
    return runs;
  }

  Scene new_scene() const
  {
    Scene scene(rtcNewScene(device_.get()));
    check("creating a scene");
    rtcSetSceneFlags(scene.get(), RTCSceneFlags(embree::filter_in_query_flag |
                                                (is_robust_ ? RTC_SCENE_FLAG_ROBUST : RTC_SCENE_FLAG_NONE)));
    return scene;
  }

  void attach_runs(RTCScene scene, const std::vector<Run> &runs) const
  {
    const Vec3f *positions =
        copied_positions_.size() != 0 ? copied_positions_.data() : scene_->positions.data();
    for (size_t i = 0; i < runs.size(); ++i) {
      const Run &run = runs[i];
      Geometry mesh(rtcNewGeometry(device_.get(), RTC_GEOMETRY_TYPE_TRIANGLE));
      rtcSetSharedGeometryBuffer(mesh.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, positions, 0,
                                 sizeof(Vec3f), scene_->positions.size());
      rtcSetSharedGeometryBuffer(mesh.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                 scene_->indices.data(), size_t(run.first_triangle) * sizeof(UInt3),
                                 sizeof(UInt3), run.num_triangles);
      if (run.is_masked) {
        rtcSetGeometryUserData(mesh.get(), const_cast<Run *>(&run));
        rtcSetGeometryIntersectFilterFunction(mesh.get(), filter_holes);
        rtcSetGeometryOccludedFilterFunction(mesh.get(), filter_holes);
      }
      rtcCommitGeometry(mesh.get());
      rtcAttachGeometryByID(scene, mesh.get(), uint32_t(i));
      check("adding triangles");
    }
  }

  // Builds on the threads of the calling arena and on no others.
  void commit(RTCScene scene) const
  {
    tbb::task_group group;
    group.run_and_wait([&] { rtcJoinCommitScene(scene); });
    check("building");
  }

  void check(const char *what) const
  {
    const RTCError error = rtcGetDeviceError(device_.get());
    if (error == RTC_ERROR_NONE) return;
    if (error == RTC_ERROR_OUT_OF_MEMORY) {
      std::lock_guard lock(mutex_);
      fail(GPURT_ERROR_OUT_OF_MEMORY, "{}",
           refusal_.empty() ? fmt::format("Embree ran out of memory {}", what) : refusal_);
    }
    fail(GPURT_ERROR_INTERNAL, "Embree failed {} (error {})", what, int(error));
  }

  static bool monitor_memory(void *user, ssize_t bytes, bool)
  {
    auto &self = *static_cast<EmbreeAccelerator *>(user);
    if (bytes < 0) {
      self.memory_->release(uint64_t(-bytes));
    } else {
      try {
        self.memory_->reserve(uint64_t(bytes), "Embree");
      } catch (const Error &error) {
        std::lock_guard lock(self.mutex_);
        self.refusal_ = error.what();
        return false;
      }
    }
    self.used_bytes_ += bytes;
    return true;
  }

  std::shared_ptr<const CompiledScene> scene_;
  std::shared_ptr<MemoryTracker> memory_;
  SceneView view_;
  bool is_robust_ = true;
  mutable std::mutex mutex_;
  std::string refusal_;
  std::atomic<int64_t> used_bytes_{0};
  TrackedArray<Vec3f> copied_positions_;
  std::vector<std::vector<Run>> runs_;
  std::vector<std::vector<uint32_t>> first_triangles_;
  std::vector<const uint32_t *> group_runs_;
  Device device_;
  std::vector<Scene> shared_;
  Scene top_;
  EmbreeView embree_view_{};
  CpuAccel queries_{};
  AccelFacts facts_;
};

}  // namespace

std::unique_ptr<Accelerator> make_embree_accelerator(const AccelContext &context, const BuildOptions &options)
{
  return std::make_unique<EmbreeAccelerator>(context, options);
}

}  // namespace gpurt
