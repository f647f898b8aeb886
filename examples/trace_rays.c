/* Casts rays at a mesh and prints what they hit. */
#include <math.h>

#include "check.h"

int main(void)
{
  gpurt_device device;
  CHECK(gpurt_device_create(NULL, &device)); /* the first GPU, else the CPU */

  /* A pyramid without a base: five vertices, four triangles, counter-clockwise from outside. */
  const float vertices[5][3] = {{-1, 0, -1}, {1, 0, -1}, {1, 0, 1}, {-1, 0, 1}, {0, 2, 0}};
  const uint32_t indices[4][3] = {{3, 2, 4}, {2, 1, 4}, {1, 0, 4}, {0, 3, 4}};
  gpurt_mesh_desc mesh = GPURT_MESH_DESC_INIT;
  mesh.vertices.data = vertices;
  mesh.vertices.count = 5;
  mesh.indices.data = indices;
  mesh.indices.count = 4;

  /* The scene has the pyramid twice: at the origin, and at x = 10. */
  gpurt_scene scene;
  uint32_t pyramid, id;
  CHECK(gpurt_scene_create(device, &scene));
  CHECK(gpurt_scene_add_mesh(scene, &mesh, &pyramid));
  gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
  instance.geometry = pyramid;
  CHECK(gpurt_scene_add_instance(scene, &instance, &id));
  instance.transform[3] = 10;
  CHECK(gpurt_scene_add_instance(scene, &instance, &id));
  CHECK(gpurt_scene_commit(scene, NULL));

  /* {origin, tmin, direction, tmax}: at the front of each pyramid, and between them. */
  const gpurt_ray rays[3] = {{{0, 1, 5}, 0, {0, 0, -1}, INFINITY},
                             {{10, 1, 5}, 0, {0, 0, -1}, INFINITY},
                             {{5, 1, 5}, 0, {0, 0, -1}, INFINITY}};
  gpurt_hit hits[3];
  gpurt_trace_desc trace = GPURT_TRACE_DESC_INIT;
  trace.num_rays = 3;
  trace.rays = rays;
  trace.hits = hits;
  CHECK(gpurt_scene_trace(scene, &trace));

  for (int i = 0; i < 3; ++i) {
    if (hits[i].primitive == GPURT_INVALID_ID) {
      printf("ray %d misses\n", i);
    } else {
      printf("ray %d: t %g, instance %u, triangle %u at (%g, %g)\n", i, hits[i].t, hits[i].instance,
             hits[i].primitive, hits[i].u, hits[i].v);
    }
  }
  /* Half way up, the front is at z = 0.5. */
  EXPECT(fabsf(hits[0].t - 4.5f) < 1e-5f && hits[0].instance == 0 && hits[0].primitive == 0);
  EXPECT(fabsf(hits[1].t - 4.5f) < 1e-5f && hits[1].instance == 1 && hits[1].primitive == 0);
  EXPECT(hits[2].primitive == GPURT_INVALID_ID && isinf(hits[2].t));

  gpurt_scene_release(scene);
  gpurt_device_release(device);
  return 0;
}
