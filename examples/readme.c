#include <gpurt.h>
#include <stdio.h>

int main(void)
{
  const float corners[3][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  gpurt_mesh_desc mesh = GPURT_MESH_DESC_INIT;
  mesh.vertices.data = corners;
  mesh.vertices.count = 3;
  gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
  const gpurt_ray ray = {{0.25f, 0.25f, 1}, 0, {0, 0, -1}, 100};
  gpurt_hit hit;
  gpurt_trace_desc trace = GPURT_TRACE_DESC_INIT;
  trace.num_rays = 1;
  trace.rays = &ray;
  trace.hits = &hit;

  gpurt_device device = NULL;
  gpurt_scene scene = NULL;
  gpurt_result result = gpurt_device_create(NULL, &device); /* the first GPU, else the CPU */
  if (!result) result = gpurt_scene_create(device, &scene);
  if (!result) result = gpurt_scene_add_mesh(scene, &mesh, &instance.geometry);
  if (!result) result = gpurt_scene_add_instance(scene, &instance, &(uint32_t){0});
  if (!result) result = gpurt_scene_commit(scene, NULL);
  if (!result) result = gpurt_scene_trace(scene, &trace);
  if (result) {
    fprintf(stderr, "%s\n", gpurt_last_error()); /* cause and remedy */
    return 1;
  }
  printf("triangle %u at t = %g\n", hit.primitive, hit.t); /* triangle 0 at t = 1 */
  gpurt_scene_release(scene);
  gpurt_device_release(device);
  return 0;
}
