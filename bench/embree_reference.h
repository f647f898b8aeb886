// Embree used directly, as the yardstick: one mesh, one ray a call.
#pragma once

#include <string>

#include "gpurt.h"
#include "triangle_scene.h"

#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

namespace bench {

class EmbreeReference {
 public:
  EmbreeReference(const TriangleScene &scene, uint32_t num_threads)
      : device_(rtcNewDevice(("threads=" + std::to_string(num_threads)).c_str()))
  {
    scene_ = rtcNewScene(device_);
    rtcSetSceneFlags(scene_, RTC_SCENE_FLAG_ROBUST);
    RTCGeometry mesh = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_TRIANGLE);
    auto *positions = static_cast<Vec3 *>(rtcSetNewGeometryBuffer(
        mesh, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(Vec3), scene.positions.size()));
    std::copy(scene.positions.begin(), scene.positions.end(), positions);
    auto *indices = static_cast<std::array<uint32_t, 3> *>(rtcSetNewGeometryBuffer(
        mesh, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(uint32_t), scene.triangles.size()));
    std::copy(scene.triangles.begin(), scene.triangles.end(), indices);
    rtcCommitGeometry(mesh);
    rtcAttachGeometry(scene_, mesh);
    rtcReleaseGeometry(mesh);
  }
  ~EmbreeReference()
  {
    rtcReleaseScene(scene_);
    rtcReleaseDevice(device_);
  }
  EmbreeReference(const EmbreeReference &) = delete;
  EmbreeReference &operator=(const EmbreeReference &) = delete;

  void build() { rtcCommitScene(scene_); }

  void closest(const gpurt_ray *rays, gpurt_hit *hits, size_t n) const
  {
    for (size_t i = 0; i < n; ++i) {
      RTCRayHit query;
      set(rays[i], query.ray);
      query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
      query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
      intersect(query);
      const bool is_hit = query.hit.geomID != RTC_INVALID_GEOMETRY_ID;
      hits[i] = {query.ray.tfar, query.hit.u, query.hit.v, is_hit ? query.hit.primID : GPURT_INVALID_ID, 0, 0,
                 {0, 0}};
    }
  }

  void occluded(const gpurt_ray *rays, uint8_t *occluded, size_t n) const
  {
    for (size_t i = 0; i < n; ++i) {
      RTCRay ray;
      set(rays[i], ray);
#if RTC_VERSION_MAJOR >= 4
      rtcOccluded1(scene_, &ray, nullptr);
#else
      RTCIntersectContext context;
      rtcInitIntersectContext(&context);
      rtcOccluded1(scene_, &context, &ray);
#endif
      occluded[i] = ray.tfar < 0;
    }
  }

 private:
  static void set(const gpurt_ray &r, RTCRay &ray)
  {
    ray.org_x = r.origin[0];
    ray.org_y = r.origin[1];
    ray.org_z = r.origin[2];
    ray.tnear = r.tmin;
    ray.dir_x = r.direction[0];
    ray.dir_y = r.direction[1];
    ray.dir_z = r.direction[2];
    ray.time = 0;
    ray.tfar = r.tmax;
    ray.mask = 0xffffffffu;
    ray.id = 0;
    ray.flags = 0;
  }

  void intersect(RTCRayHit &query) const
  {
#if RTC_VERSION_MAJOR >= 4
    rtcIntersect1(scene_, &query, nullptr);
#else
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcIntersect1(scene_, &context, &query);
#endif
  }

  RTCDevice device_;
  RTCScene scene_;
};

}  // namespace bench
