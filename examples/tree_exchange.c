/* Takes the kd-tree out of a scene, looks into it, and builds another scene with it. */
#include <math.h>
#include <string.h>

#include "check.h"

enum { grid = 24, num_vertices = (grid + 1) * (grid + 1), num_triangles = 2 * grid * grid, num_rays = 256 };

/* A landscape. */
static gpurt_scene create_scene(gpurt_device device)
{
  static float vertices[num_vertices][3];
  static uint32_t indices[num_triangles][3];
  for (uint32_t y = 0, triangle = 0; y <= grid; ++y) {
    for (uint32_t x = 0; x <= grid; ++x) {
      uint32_t i = y * (grid + 1) + x;
      vertices[i][0] = (float)x;
      vertices[i][1] = (float)(x * y % 5);
      vertices[i][2] = (float)y;
      if (x == grid || y == grid) continue;
      const uint32_t corners[2][3] = {{i, i + grid + 1, i + 1}, {i + 1, i + grid + 1, i + grid + 2}};
      memcpy(indices[triangle], corners, sizeof corners);
      triangle += 2;
    }
  }
  gpurt_mesh_desc mesh = GPURT_MESH_DESC_INIT;
  mesh.vertices.data = vertices;
  mesh.vertices.count = num_vertices;
  mesh.indices.data = indices;
  mesh.indices.count = num_triangles;
  gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
  gpurt_scene scene;
  uint32_t id;
  CHECK(gpurt_scene_create(device, &scene));
  CHECK(gpurt_scene_add_mesh(scene, &mesh, &instance.geometry));
  CHECK(gpurt_scene_add_instance(scene, &instance, &id));
  return scene;
}

static void commit(gpurt_scene scene)
{
  gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
  build.accel = GPURT_ACCEL_KDTREE; /* the CPU's default is Embree */
  CHECK(gpurt_scene_commit(scene, &build));
}

static void trace(gpurt_scene scene, gpurt_hit hits[num_rays])
{
  gpurt_ray rays[num_rays];
  for (int i = 0; i < num_rays; ++i) {
    gpurt_ray ray = {{(float)(i % 16) * 1.5f, 20, (float)(i / 16) * 1.5f}, 0, {0.1f, -1, 0.2f}, INFINITY};
    rays[i] = ray;
  }
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.num_rays = num_rays;
  desc.rays = rays;
  desc.hits = hits;
  CHECK(gpurt_scene_trace(scene, &desc));
}

int main(void)
{
  gpurt_device device;
  CHECK(gpurt_device_create(NULL, &device));
  gpurt_scene first = create_scene(device);
  commit(first);

  /* Ask for the sizes, then for the tree. */
  gpurt_kdtree tree = GPURT_KDTREE_INIT;
  CHECK(gpurt_scene_export_tree(first, &tree));
  tree.nodes = malloc(tree.num_nodes * sizeof *tree.nodes);
  tree.references = malloc(tree.num_references * sizeof *tree.references);
  EXPECT(tree.nodes != NULL && tree.references != NULL);
  CHECK(gpurt_scene_export_tree(first, &tree));

  uint64_t leaves = 0, references = 0;
  for (uint64_t i = 0; i < tree.num_nodes; ++i) {
    const gpurt_kdtree_node node = tree.nodes[i];
    if ((node.tag & 3) == 3) {
      ++leaves;
      references += node.tag >> 2;
    }
  }
  printf("%llu triangles, %llu nodes, %llu leaves, %llu references\n", (unsigned long long)tree.num_triangles,
         (unsigned long long)tree.num_nodes, (unsigned long long)leaves, (unsigned long long)references);
  EXPECT(tree.num_triangles == num_triangles);
  EXPECT(leaves == (tree.num_nodes + 1) / 2); /* of a binary tree */

  /* Another scene of the same geometry takes the tree instead of building one. */
  gpurt_scene second = create_scene(device);
  CHECK(gpurt_scene_import_tree(second, &tree)); /* copied, and checked: a bad one cannot crash anything */
  free(tree.nodes);
  free(tree.references);
  commit(second);
  gpurt_scene_facts facts = GPURT_SCENE_FACTS_INIT;
  CHECK(gpurt_scene_get_facts(second, &facts));
  EXPECT(facts.tree_from_cache && facts.num_nodes == tree.num_nodes);

  static gpurt_hit hits[2][num_rays];
  trace(first, hits[0]);
  trace(second, hits[1]);
  EXPECT(memcmp(hits[0], hits[1], sizeof hits[0]) == 0);
  EXPECT(hits[0][num_rays / 2].primitive != GPURT_INVALID_ID);
  printf("both trees give the same hits\n");

  gpurt_scene_release(first);
  gpurt_scene_release(second);
  gpurt_device_release(device);
  return 0;
}
