// A TriangleScene committed to gpurt.
#pragma once

#include <cstdio>
#include <cstdlib>

#include "gpurt.h"
#include "triangle_scene.h"

namespace bench {

inline void check(gpurt_result result, const char *what)
{
  if (result == GPURT_OK) return;
  std::fprintf(stderr, "%s: %s: %s\n", what, gpurt_result_name(result), gpurt_last_error());
  std::exit(1);
}

class GpurtScene {
 public:
  GpurtScene(gpurt_device device, const TriangleScene &source)
  {
    check(gpurt_scene_create(device, &scene_), "creating a scene");
    gpurt_mesh_desc mesh = GPURT_MESH_DESC_INIT;
    mesh.vertices = {source.positions.data(), nullptr, 0, 0, source.positions.size()};
    mesh.indices = {source.triangles.data(), nullptr, 0, 0, source.triangles.size()};
    uint32_t geometry = 0, instance = 0;
    check(gpurt_scene_add_mesh(scene_, &mesh, &geometry), "adding the mesh");
    gpurt_instance_desc place = GPURT_INSTANCE_DESC_INIT;
    place.geometry = geometry;
    check(gpurt_scene_add_instance(scene_, &place, &instance), "placing the mesh");
  }
  ~GpurtScene() { gpurt_scene_release(scene_); }
  GpurtScene(const GpurtScene &) = delete;
  GpurtScene &operator=(const GpurtScene &) = delete;

  gpurt_scene_facts commit(gpurt_accel accel, gpurt_triangle_test test = GPURT_TRIANGLE_WATERTIGHT)
  {
    gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
    build.accel = accel;
    build.triangle_test = test;
    check(gpurt_scene_commit(scene_, &build), "committing");
    gpurt_scene_facts facts = GPURT_SCENE_FACTS_INIT;
    check(gpurt_scene_get_facts(scene_, &facts), "reading facts");
    return facts;
  }

  gpurt_scene get() const { return scene_; }

 private:
  gpurt_scene scene_ = nullptr;
};

}  // namespace bench
