/* Lets a scene read the program's own memory instead of a copy, and learns when it may be freed. */
#include <math.h>

#include "check.h"

struct Particle { /* the program's own layout */
  float mass;
  float position[3];
  float charge;
};

static int num_released;

static void free_particles(void *user, void *data)
{
  (void)user;
  ++num_released;
  free(data);
}

int main(void)
{
  gpurt_device device;
  CHECK(gpurt_device_create(NULL, &device));

  enum { count = 3 };
  struct Particle *particles = calloc(count, sizeof *particles);
  EXPECT(particles != NULL);
  particles[1].position[0] = 1;
  particles[2].position[1] = 1;

  gpurt_buffer_desc buffer_desc = GPURT_BUFFER_DESC_INIT;
  buffer_desc.size_bytes = count * sizeof *particles;
  buffer_desc.data = particles; /* the buffer owns it now, and gives it back through free_particles */
  buffer_desc.release = free_particles;
  gpurt_buffer buffer;
  CHECK(gpurt_buffer_create(device, &buffer_desc, &buffer));

  /* One triangle whose corners are the particles: where they begin, and how far apart they are. */
  gpurt_scene scene;
  CHECK(gpurt_scene_create(device, &scene));
  gpurt_mesh_desc mesh = GPURT_MESH_DESC_INIT;
  mesh.vertices.buffer = buffer;
  mesh.vertices.offset_bytes = offsetof(struct Particle, position);
  mesh.vertices.stride_bytes = sizeof *particles;
  mesh.vertices.count = count;
  gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
  uint32_t id;
  CHECK(gpurt_scene_add_mesh(scene, &mesh, &instance.geometry));
  CHECK(gpurt_scene_add_instance(scene, &instance, &id));
  gpurt_buffer_release(buffer); /* the scene still holds it */
  CHECK(gpurt_scene_commit(scene, NULL));

  const gpurt_ray ray = {{0.25f, 0.25f, 1}, 0, {0, 0, -1}, INFINITY};
  gpurt_hit hit;
  gpurt_trace_desc trace = GPURT_TRACE_DESC_INIT;
  trace.num_rays = 1;
  trace.rays = &ray;
  trace.hits = &hit;
  CHECK(gpurt_scene_trace(scene, &trace));
  printf("t %g\n", hit.t);
  EXPECT(fabsf(hit.t - 1) < 1e-6f && hit.primitive == 0);

  gpurt_scene_release(scene);
  gpurt_device_release(device);
  EXPECT(num_released == 1);
  printf("the memory came back\n");
  return 0;
}
