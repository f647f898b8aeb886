/* A small scene for the examples that render: a room of 2 x 2 x 2 metres with a lamp and a block, seen from its open
 * side. */
#ifndef GPURT_EXAMPLES_ROOM_H
#define GPURT_EXAMPLES_ROOM_H

#include "check.h"

/* Adds the parallelogram with the corners p, p + a, p + a + b, p + b, and places it; a x b is its front. */
static inline void add_parallelogram(gpurt_scene scene, uint32_t material, const float p[3], const float a[3],
                                     const float b[3])
{
  static const uint32_t indices[2][3] = {{0, 1, 2}, {0, 2, 3}};
  float vertices[4][3];
  for (int i = 0; i < 3; ++i) {
    vertices[0][i] = p[i];
    vertices[1][i] = p[i] + a[i];
    vertices[2][i] = p[i] + a[i] + b[i];
    vertices[3][i] = p[i] + b[i];
  }
  gpurt_mesh_desc mesh = GPURT_MESH_DESC_INIT;
  mesh.material = material;
  mesh.vertices.data = vertices; /* copied during the call */
  mesh.vertices.count = 4;
  mesh.indices.data = indices;
  mesh.indices.count = 2;
  gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
  CHECK(gpurt_scene_add_mesh(scene, &mesh, &instance.geometry));
  CHECK(gpurt_scene_add_instance(scene, &instance, &(uint32_t){0}));
}

static inline uint32_t add_color(gpurt_scene scene, float r, float g, float b, float radiance)
{
  uint32_t id;
  gpurt_material_desc material = GPURT_MATERIAL_DESC_INIT;
  material.base_color[0] = r;
  material.base_color[1] = g;
  material.base_color[2] = b;
  for (int i = 0; i < 3; ++i) material.emission[i] = radiance;
  CHECK(gpurt_scene_add_material(scene, &material, &id));
  return id;
}

static inline gpurt_scene create_room(gpurt_device device)
{
  gpurt_scene scene;
  CHECK(gpurt_scene_create(device, &scene));
  uint32_t white = add_color(scene, 0.75f, 0.75f, 0.75f, 0);
  uint32_t red = add_color(scene, 0.65f, 0.05f, 0.05f, 0);
  uint32_t green = add_color(scene, 0.1f, 0.45f, 0.1f, 0);
  uint32_t lamp = add_color(scene, 0, 0, 0, 15);

  const float x[3] = {2, 0, 0}, y[3] = {0, 2, 0}, z[3] = {0, 0, 2};
  const float low[3] = {-1, -1, -1}, right[3] = {1, -1, -1}, top[3] = {-1, 1, -1};
  add_parallelogram(scene, white, low, z, x);   /* floor */
  add_parallelogram(scene, white, top, x, z);   /* ceiling */
  add_parallelogram(scene, white, low, x, y);   /* back wall */
  add_parallelogram(scene, red, low, y, z);     /* left wall */
  add_parallelogram(scene, green, right, z, y); /* right wall */
  add_parallelogram(scene, lamp, (float[]){-0.3f, 0.99f, -0.3f}, (float[]){0.6f, 0, 0},
                    (float[]){0, 0, 0.6f});

  /* A block: its top and the two sides that the camera sees. */
  const float front_left[3] = {-0.5f, -1, 0.1f};
  const float width[3] = {0.7f, 0, 0.2f}, up[3] = {0, 0.9f, 0}, depth[3] = {0.2f, 0, -0.7f};
  add_parallelogram(scene, white, front_left, width, up);
  add_parallelogram(scene, white, (float[]){0.2f, -1, 0.3f}, depth, up);
  add_parallelogram(scene, white, (float[]){-0.5f, -0.1f, 0.1f}, width, depth);

  gpurt_camera_desc camera = GPURT_CAMERA_DESC_INIT; /* looks along -Z */
  camera.transform[11] = 3.6f;                       /* from in front of the room */
  CHECK(gpurt_scene_add_camera(scene, &camera, &(uint32_t){0}));
  CHECK(gpurt_scene_commit(scene, NULL));
  return scene;
}

#endif
