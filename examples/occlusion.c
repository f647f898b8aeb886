/* Which points of a floor does a lamp see past a roof? Threads share one scene, and ask for a row each. */
#define _POSIX_C_SOURCE 200809L
#include <pthread.h>

#include "check.h"

enum { num_rows = 8, num_columns = 32 };

struct Row {
  gpurt_scene scene;
  float z;
  uint8_t occluded[num_columns];
};

static float column_x(int column) { return (float)(column - num_columns / 2) * 0.25f + 0.125f; }

static void *trace_row(void *argument)
{
  struct Row *row = argument;
  gpurt_ray rays[num_columns];
  for (int i = 0; i < num_columns; ++i) {
    /* From the floor to the lamp at (0, 4, 0): t in [0, 1] is the way between the two. */
    gpurt_ray ray = {{column_x(i), 0, row->z}, 0, {-column_x(i), 4, -row->z}, 1};
    rays[i] = ray;
  }
  gpurt_trace_desc trace = GPURT_TRACE_DESC_INIT;
  trace.query = GPURT_QUERY_ANY; /* whether, not what: it stops at the first hit of any kind */
  trace.num_rays = num_columns;
  trace.rays = rays;
  trace.occluded = row->occluded;
  CHECK(gpurt_scene_trace(row->scene, &trace)); /* gpurt_last_error() is the thread's own */
  return NULL;
}

int main(void)
{
  gpurt_device device;
  gpurt_scene scene;
  CHECK(gpurt_device_create(NULL, &device));
  CHECK(gpurt_scene_create(device, &scene));

  /* The roof: 2 x 2 metres, at height 2. Without indices, vertices form triangles three by three. */
  const float roof[6][3] = {{-1, 2, -1}, {1, 2, -1}, {1, 2, 1}, {-1, 2, -1}, {1, 2, 1}, {-1, 2, 1}};
  gpurt_mesh_desc mesh = GPURT_MESH_DESC_INIT;
  mesh.vertices.data = roof;
  mesh.vertices.count = 6;
  gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
  uint32_t id;
  CHECK(gpurt_scene_add_mesh(scene, &mesh, &instance.geometry));
  CHECK(gpurt_scene_add_instance(scene, &instance, &id));
  CHECK(gpurt_scene_commit(scene, NULL));

  struct Row rows[num_rows];
  pthread_t threads[num_rows];
  for (int i = 0; i < num_rows; ++i) {
    rows[i].scene = scene;
    rows[i].z = (float)(i - num_rows / 2) * 0.75f + 0.375f;
    if (pthread_create(&threads[i], NULL, trace_row, &rows[i]) != 0) {
      fprintf(stderr, "cannot start a thread\n");
      return 1;
    }
  }
  for (int i = 0; i < num_rows; ++i) pthread_join(threads[i], NULL);

  for (int i = 0; i < num_rows; ++i) {
    for (int j = 0; j < num_columns; ++j) {
      /* The roof is half way up, so its shadow is twice as large: x and z in [-2, 2]. */
      float x = column_x(j), z = rows[i].z;
      EXPECT(rows[i].occluded[j] == (x > -2 && x < 2 && z > -2 && z < 2));
      putchar(rows[i].occluded[j] ? '#' : '.');
    }
    putchar('\n');
  }

  gpurt_scene_release(scene);
  gpurt_device_release(device);
  return 0;
}
