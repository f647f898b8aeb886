// Commits: what a failed one leaves, what work in flight sees, the memory limit, the tree exchange.
#include "abi_test.h"
#include "gpurt_cuda.h"

namespace {

using namespace gpurt_test;

gpurt_scene_facts facts_of(gpurt_scene scene)
{
  gpurt_scene_facts f = GPURT_SCENE_FACTS_INIT;
  GPURT_EXPECT_OK(gpurt_scene_get_facts(scene, &f));
  return f;
}

gpurt_device_properties properties_of(gpurt_device device)
{
  gpurt_device_properties p = GPURT_DEVICE_PROPERTIES_INIT;
  GPURT_EXPECT_OK(gpurt_device_get_properties(device, &p));
  return p;
}

TEST(Commits, EmptyScenesMiss)
{
  const Device device = make_device();
  const Scene scene = make_scene(device);
  for (const gpurt_accel accel :
       {GPURT_ACCEL_AUTO, GPURT_ACCEL_KDTREE, GPURT_ACCEL_EMBREE, GPURT_ACCEL_BVH}) {
    commit(scene, accel);
    const gpurt_hit hit = trace_closest(scene, {ray_at_triangle()})[0];
    EXPECT_EQ(hit.primitive, GPURT_INVALID_ID);
    EXPECT_EQ(hit.geometry, GPURT_INVALID_ID);
    EXPECT_EQ(hit.instance, GPURT_INVALID_ID);
    EXPECT_EQ(hit.t, 100.0f);
  }
  const gpurt_scene_facts f = facts_of(scene);
  EXPECT_EQ(f.num_triangles, 0u);
  EXPECT_GT(f.bounds_min[0], f.bounds_max[0]);
}

TEST(Commits, FactsTellWhatTheyBuilt)
{
  const Device device = make_device();
  const Scene scene = make_scene(device);
  gpurt_scene_facts f = facts_of(scene);
  EXPECT_EQ(f.is_committed, 0u);
  EXPECT_EQ(f.accel_bytes, 0u);
  EXPECT_EQ(f.num_materials, 0u);

  const uint32_t lamp = add_material(scene, GPURT_MATERIAL_LAMBERT, {1, 1, 1}, {5, 5, 5});
  add_material(scene, GPURT_MATERIAL_GLASS, {1, 1, 1});
  add_mesh(scene, icosphere(1));
  const uint32_t shared = add_mesh(scene, quad({0, 0, 9}, {1, 0, 9}, {1, 1, 9}, {0, 1, 9}), lamp);
  gpurt_instance_desc again = GPURT_INSTANCE_DESC_INIT;
  again.geometry = shared;
  again.transform[3] = 10;
  uint32_t instance = 0;
  GPURT_EXPECT_OK(gpurt_scene_add_instance(scene, &again, &instance));
  EXPECT_EQ(instance, 2u);
  gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
  light.intensity[0] = 1;
  uint32_t id;
  GPURT_EXPECT_OK(gpurt_scene_add_light(scene, &light, &id));
  light.type = GPURT_LIGHT_DISTANT;
  light.direction[1] = -1;
  GPURT_EXPECT_OK(gpurt_scene_add_light(scene, &light, &id));
  commit(scene);
  f = facts_of(scene);
  EXPECT_EQ(f.num_geometries, 2u);
  EXPECT_EQ(f.num_instances, 3u);
  EXPECT_EQ(f.num_materials, 2u);
  EXPECT_EQ(f.num_point_lights, 1u);
  EXPECT_EQ(f.num_distant_lights, 1u);
  EXPECT_EQ(f.num_triangles, 82u);
  EXPECT_EQ(f.num_world_triangles, 84u);
  EXPECT_EQ(f.num_emissive_triangles, 4u);
  EXPECT_FLOAT_EQ(f.bounds_max[0], 11.0f);  // instances are bounded with their rounding
  EXPECT_FLOAT_EQ(f.bounds_max[2], 9.0f);
  EXPECT_EQ(f.has_glass, 1u);
  EXPECT_EQ(f.has_environment, 0u);
  EXPECT_EQ(f.has_alpha_masks, 0u);
  EXPECT_EQ(f.is_committed, 1u);
  EXPECT_EQ(f.accel, GPURT_ACCEL_KDTREE);
  EXPECT_EQ(f.triangle_test, GPURT_TRIANGLE_WATERTIGHT);
  EXPECT_GT(f.num_nodes, 0u);
  EXPECT_GT(f.accel_bytes, 0u);
  EXPECT_GT(f.scene_bytes, f.accel_bytes);
  EXPECT_GT(f.build_seconds, 0.0);
  commit(scene, GPURT_ACCEL_AUTO);
  EXPECT_EQ(facts_of(scene).accel, GPURT_ACCEL_EMBREE);
  commit(scene, GPURT_ACCEL_BVH, GPURT_TRIANGLE_DOUBLE);
  f = facts_of(scene);
  EXPECT_EQ(f.accel, GPURT_ACCEL_BVH);
  EXPECT_EQ(f.triangle_test, GPURT_TRIANGLE_DOUBLE);
  EXPECT_GT(f.num_nodes, 0u);
  EXPECT_GE(f.num_references, f.num_triangles);
  EXPECT_GT(f.tree_depth, 0u);
  EXPECT_GT(f.sah_cost, 0.0);
  EXPECT_GT(f.accel_bytes, 0u);
  gpurt_kdtree tree = GPURT_KDTREE_INIT;
  EXPECT_EQ(gpurt_scene_export_tree(scene, &tree), GPURT_ERROR_INVALID_ARGUMENT);
  EXPECT_NE(std::string(gpurt_last_error()).find("kdtree"), std::string::npos) << gpurt_last_error();
}

// What AUTO means follows from the other settings: a setting of the kd-tree asks for the kd-tree.
TEST(Commits, AutoHeedsTheOtherSettings)
{
  const Device device = make_device();
  const Scene scene = make_triangle_scene(device);
  gpurt_build_desc desc = GPURT_BUILD_DESC_INIT;
  desc.max_depth = 5;
  GPURT_EXPECT_OK(gpurt_scene_commit(scene, &desc));
  EXPECT_EQ(facts_of(scene).accel, GPURT_ACCEL_KDTREE);
  desc = GPURT_BUILD_DESC_INIT;
  desc.triangle_test = GPURT_TRIANGLE_DOUBLE;
  GPURT_EXPECT_OK(gpurt_scene_commit(scene, &desc));
  EXPECT_EQ(facts_of(scene).accel, GPURT_ACCEL_KDTREE);
  EXPECT_EQ(facts_of(scene).triangle_test, GPURT_TRIANGLE_DOUBLE);
}

TEST(Commits, FailedOnesKeepTheOldScene)
{
  const Device device = make_device();
  const Scene scene = make_triangle_scene(device);
  add_mesh(scene, {{{0, 0, 0.5f}, {1, 0, 0.5f}, {0, 1, 0.5f}}, {{0, 1, 2}}});
  gpurt_build_desc desc = GPURT_BUILD_DESC_INIT;
  desc.accel = GPURT_ACCEL_EMBREE;
  desc.triangle_test = GPURT_TRIANGLE_DOUBLE;
  EXPECT_EQ(gpurt_scene_commit(scene, &desc), GPURT_ERROR_UNSUPPORTED);
  EXPECT_EQ(trace_closest(scene, {ray_at_triangle()})[0].t, 1.0f) << "the mesh is not committed yet";
  commit(scene);
  EXPECT_EQ(trace_closest(scene, {ray_at_triangle()})[0].t, 0.5f);
}

// A frame renders the commit that it was created with.
TEST(Commits, FramesKeepTheirCommit)
{
  const Device device = make_device();
  const Scene scene = make_triangle_scene(device);
  const RenderOptions options{8, 8, 4};
  const Frame before = make_frame(scene, options), reference = make_frame(scene, options);
  render(reference, options);
  set_environment(scene, 7);
  commit(scene);
  render(before, options);
  EXPECT_EQ(read_color(before, options), read_color(reference, options));
  const Frame after = make_frame(scene, options);
  render(after, options);
  EXPECT_GT(mean(read_color(after, options)), 2 * mean(read_color(reference, options)));
}

// Row 48 of the failure catalogue: over the limit there is an error, and then everything works as before.
TEST(MemoryLimit, IsAnErrorAndTheNextCallWorks)
{
  const uint64_t limit = 1u << 20;
  const Device device = make_device(GPURT_DEVICE_CPU, 2, limit);
  EXPECT_EQ(properties_of(device).memory_limit_bytes, limit);
  const Scene scene = make_triangle_scene(device);
  const uint64_t used = properties_of(device).memory_used_bytes;
  EXPECT_GT(used, 0u);

  // Too large to describe: the copy of a mesh.
  const Mesh large = icosphere(6);  // 81920 triangles: 983040 bytes of indices, 491544 of vertices
  gpurt_mesh_desc mesh = GPURT_MESH_DESC_INIT;
  mesh.vertices = {large.vertices.data(), nullptr, 0, 0, large.vertices.size()};
  mesh.indices = {large.triangles.data(), nullptr, 0, 0, large.triangles.size()};
  uint32_t id;
  expect_failure(GPURT_ERROR_OUT_OF_MEMORY, "memory_limit_bytes", "add_mesh",
                 [&] { return gpurt_scene_add_mesh(scene, &mesh, &id); });
  EXPECT_EQ(properties_of(device).memory_used_bytes, used);
  EXPECT_EQ(facts_of(scene).num_geometries, 1u);

  // Large enough to describe, too large to build.
  {
    const Scene second = make_scene(device);
    add_mesh(second, icosphere(5));  // 20480 triangles: 368 kB of description
    EXPECT_GT(properties_of(device).memory_used_bytes, used + 360000);
    expect_failure(GPURT_ERROR_OUT_OF_MEMORY, "memory_limit_bytes", "commit",
                   [&] { return gpurt_scene_commit(second, nullptr); });
  }
  EXPECT_EQ(properties_of(device).memory_used_bytes, used);

  // Frames, textures and buffers count too.
  Frame frame;
  gpurt_frame_desc frame_desc = GPURT_FRAME_DESC_INIT;
  frame_desc.width = frame_desc.height = 4096;
  expect_failure(GPURT_ERROR_OUT_OF_MEMORY, "memory_limit_bytes", "frame",
                 [&] { return gpurt_frame_create(scene, &frame_desc, frame.out()); });
  const std::vector<unsigned char> texels(4u << 20);
  gpurt_texture_desc texture = GPURT_TEXTURE_DESC_INIT;
  texture.width = texture.height = 1024;
  texture.texels = texels.data();
  expect_failure(GPURT_ERROR_OUT_OF_MEMORY, "memory_limit_bytes", "texture",
                 [&] { return gpurt_scene_add_texture(scene, &texture, &id); });
  for (const uint64_t bytes : {2 * limit, uint64_t(1) << 50, UINT64_MAX}) {
    gpurt_buffer_desc buffer = GPURT_BUFFER_DESC_INIT;
    buffer.size_bytes = bytes;
    Buffer out;
    expect_failure(GPURT_ERROR_OUT_OF_MEMORY, "bytes", "buffer",
                   [&] { return gpurt_buffer_create(device, &buffer, out.out()); });
  }
  EXPECT_EQ(properties_of(device).memory_used_bytes, used);
  EXPECT_LE(properties_of(device).memory_peak_bytes, limit);

  // Everything of before works, and so does a new commit.
  EXPECT_EQ(trace_closest(scene, {ray_at_triangle()})[0].primitive, 0u);
  commit(scene);
  EXPECT_EQ(trace_closest(scene, {ray_at_triangle()})[0].primitive, 0u);
}

TEST(MemoryLimit, WithoutALimitTheSystemIsTheLimit)
{
  const Device device = make_device();
  gpurt_buffer_desc buffer = GPURT_BUFFER_DESC_INIT;
  for (const uint64_t bytes : {uint64_t(1) << 50, UINT64_MAX, UINT64_MAX - 63}) {
    buffer.size_bytes = bytes;
    Buffer out;
    expect_failure(GPURT_ERROR_OUT_OF_MEMORY, "", "buffer",
                   [&] { return gpurt_buffer_create(device, &buffer, out.out()); });
  }
  EXPECT_EQ(properties_of(device).memory_used_bytes, 0u);
}

TEST(MemoryLimit, MemoryIsGivenBack)
{
  const Device device = make_device();
  {
    const Scene scene = make_triangle_scene(device, GPURT_ACCEL_EMBREE);
    commit(scene);
    const Frame frame = make_frame(scene, {64, 64, 1});
    render(frame, {64, 64, 1});
    EXPECT_GT(properties_of(device).memory_used_bytes, 64u * 64 * 100);
  }
  EXPECT_EQ(properties_of(device).memory_used_bytes, 0u);
  EXPECT_GT(properties_of(device).memory_peak_bytes, 64u * 64 * 100);
}

struct Tree {
  std::vector<gpurt_kdtree_node> nodes;
  std::vector<uint32_t> references;
  gpurt_kdtree desc = GPURT_KDTREE_INIT;

  const gpurt_kdtree *get()
  {
    desc.nodes = nodes.data();
    desc.num_nodes = nodes.size();
    desc.references = references.data();
    desc.num_references = references.size();
    return &desc;
  }
  static gpurt_kdtree_node inner(uint32_t child, uint32_t axis, float plane)
  {
    gpurt_kdtree_node n{0, child << 2 | axis};
    std::memcpy(&n.word, &plane, 4);
    return n;
  }
  static gpurt_kdtree_node leaf(uint32_t first, uint32_t count) { return {first, count << 2 | 3}; }
};

Tree exported(gpurt_scene scene, uint32_t which = 0)
{
  Tree t;
  t.desc.tree = which;
  GPURT_EXPECT_OK(gpurt_scene_export_tree(scene, &t.desc));
  t.nodes.resize(t.desc.num_nodes);
  t.references.resize(t.desc.num_references);
  t.desc.nodes = t.nodes.data();
  t.desc.references = t.references.data();
  GPURT_EXPECT_OK(gpurt_scene_export_tree(scene, &t.desc));
  return t;
}

std::vector<gpurt_ray> rays_at_sphere()
{
  std::vector<gpurt_ray> rays;
  std::mt19937 random(5);
  std::uniform_real_distribution<float> u(-1.2f, 1.2f);
  for (int i = 0; i < 2000; ++i)
    rays.push_back({{u(random), u(random), 3}, 0, {u(random), u(random), -3}, 100});
  return rays;
}

bool same_hits(const std::vector<gpurt_hit> &a, const std::vector<gpurt_hit> &b)
{
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(gpurt_hit)) == 0;
}

TEST(TreeExchange, RoundTripGivesTheSameHits)
{
  const Device device = make_device();
  Scene scene = make_scene(device);
  add_mesh(scene, icosphere(3));
  commit(scene);
  const std::vector<gpurt_hit> built = trace_closest(scene, rays_at_sphere());
  Tree tree = exported(scene);
  EXPECT_EQ(tree.desc.num_triangles, 1280u);
  GPURT_ASSERT_OK(gpurt_scene_import_tree(scene, tree.get()));
  commit(scene, GPURT_ACCEL_AUTO);
  EXPECT_EQ(facts_of(scene).accel, GPURT_ACCEL_KDTREE) << "an imported tree is there to be used";
  EXPECT_EQ(facts_of(scene).tree_from_cache, 1u);
  EXPECT_TRUE(same_hits(trace_closest(scene, rays_at_sphere()), built));
  const Tree again = exported(scene);
  ASSERT_EQ(again.nodes.size(), tree.nodes.size());
  EXPECT_EQ(std::memcmp(again.nodes.data(), tree.nodes.data(), tree.nodes.size() * 8), 0);
  EXPECT_EQ(again.references, tree.references);

  // A single leaf with everything is a tree too, and gives the same hits.
  Tree flat;
  flat.desc = tree.desc;
  flat.nodes = {Tree::leaf(0, 1280)};
  for (uint32_t i = 0; i < 1280; ++i) flat.references.push_back(i);
  GPURT_ASSERT_OK(gpurt_scene_import_tree(scene, flat.get()));
  commit(scene);
  EXPECT_EQ(facts_of(scene).num_nodes, 1u);
  EXPECT_TRUE(same_hits(trace_closest(scene, rays_at_sphere()), built));

  // New geometry: the import is gone, a tree is built.
  add_mesh(scene, {{{5, 5, 5}, {6, 5, 5}, {5, 6, 5}}, {{0, 1, 2}}});
  commit(scene);
  EXPECT_EQ(facts_of(scene).tree_from_cache, 0u);
  EXPECT_GT(facts_of(scene).num_nodes, 1u);
  EXPECT_TRUE(same_hits(trace_closest(scene, rays_at_sphere()), built));
}

TEST(TreeExchange, OfSharedGeometries)
{
  const Device device = make_device();
  const Scene scene = make_scene(device);
  const uint32_t sphere = add_mesh(scene, icosphere(2));
  gpurt_instance_desc second = GPURT_INSTANCE_DESC_INIT;
  second.geometry = sphere;
  second.transform[3] = 0.5f;
  uint32_t id;
  GPURT_ASSERT_OK(gpurt_scene_add_instance(scene, &second, &id));
  commit(scene);
  const std::vector<gpurt_hit> built = trace_closest(scene, rays_at_sphere());
  Tree tree = exported(scene, 1);
  EXPECT_EQ(tree.desc.num_triangles, 320u);
  GPURT_ASSERT_OK(gpurt_scene_import_tree(scene, tree.get()));
  commit(scene);
  EXPECT_TRUE(same_hits(trace_closest(scene, rays_at_sphere()), built));
  tree.desc.tree = 0;
  expect_invalid("tree 0", "import", [&] { return gpurt_scene_import_tree(scene, tree.get()); });
  tree.desc.tree = 2;
  expect_invalid("tree is 2", "import", [&] { return gpurt_scene_import_tree(scene, tree.get()); });
  expect_invalid("", "export", [&] { return gpurt_scene_export_tree(scene, std::array{tree.desc}.data()); });
}

TEST(TreeExchange, RefusesTreesThatCannotBeWalked)
{
  const Device device = make_device();
  const Scene scene = make_triangle_scene(device);
  const auto valid = [] {
    Tree t;
    t.desc.num_triangles = 1;
    t.desc.bounds_max[0] = t.desc.bounds_max[1] = 1;
    t.nodes = {Tree::inner(1, 0, 0.5f), Tree::leaf(0, 1), Tree::leaf(0, 1)};
    t.references = {0};
    return t;
  };
  GPURT_EXPECT_OK(gpurt_scene_import_tree(scene, valid().get()));
  const auto refuse = [&](const std::string &part, auto change) {
    Tree t = valid();
    change(t);
    expect_invalid(part, part, [&] { return gpurt_scene_import_tree(scene, t.get()); });
  };
  refuse("reference 0 of the kd-tree is triangle 1", [](Tree &t) { t.references[0] = 1; });
  refuse("leaf 1 of the kd-tree", [](Tree &t) { t.nodes[1] = Tree::leaf(0, 2); });
  refuse("leaf 2 of the kd-tree", [](Tree &t) { t.nodes[2] = Tree::leaf(0xffffffffu, 1); });
  refuse("node 0 of the kd-tree has its children at 2 and 3",
         [](Tree &t) { t.nodes[0] = Tree::inner(2, 0, 0.5f); });
  refuse("node 0 of the kd-tree has its children at 0 and 1",
         [](Tree &t) { t.nodes[0] = Tree::inner(0, 0, 0.5f); });
  refuse("splits at 1.5", [](Tree &t) { t.nodes[0] = Tree::inner(1, 0, 1.5f); });
  refuse("splits at nan", [](Tree &t) { t.nodes[0] = Tree::inner(1, 0, std::nanf("")); });
  refuse("bounds", [](Tree &t) { t.desc.bounds_min[1] = 2; });
  refuse("bounds", [](Tree &t) { t.desc.bounds_max[1] = INFINITY; });
  refuse("node 3 of the kd-tree is never reached", [](Tree &t) { t.nodes.push_back(Tree::leaf(0, 1)); });
  refuse("no node", [](Tree &t) { t.nodes.clear(); });
  refuse("num_triangles is 2", [](Tree &t) { t.desc.num_triangles = 2; });
  refuse("node 3 of the kd-tree is reached twice", [](Tree &t) {
    t.nodes = {Tree::inner(1, 0, 0.5f), Tree::inner(3, 1, 0.5f), Tree::inner(3, 1, 0.5f), Tree::leaf(0, 1),
               Tree::leaf(0, 1)};
  });
  Tree t = valid();
  t.get();
  t.desc.num_nodes = UINT64_MAX;
  expect_invalid("num_nodes", "import", [&] { return gpurt_scene_import_tree(scene, &t.desc); });
  t.get();
  t.desc.num_references = UINT64_MAX;
  expect_invalid("num_references", "import", [&] { return gpurt_scene_import_tree(scene, &t.desc); });
  t.get();
  t.desc.nodes = nullptr;
  expect_invalid("nodes is NULL", "import", [&] { return gpurt_scene_import_tree(scene, &t.desc); });

  // Bounds that leave triangles out are seen where the triangles are known.
  Tree small = valid();
  small.desc.bounds_max[0] = 0.75f;
  GPURT_EXPECT_OK(gpurt_scene_import_tree(scene, small.get()));
  gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
  build.accel = GPURT_ACCEL_KDTREE;
  expect_invalid("bounds do not contain triangle 0", "commit",
                 [&] { return gpurt_scene_commit(scene, &build); });
  EXPECT_EQ(trace_closest(scene, {ray_at_triangle()})[0].primitive, 0u);
}

// Row 18 of the failure catalogue.
TEST(TreeExchange, RefusesADepthOf49)
{
  const Device device = make_device();
  const Scene scene = make_triangle_scene(device);
  for (const int depth : {48, 49}) {
    Tree t;
    t.desc.num_triangles = 1;
    t.desc.bounds_max[0] = t.desc.bounds_max[1] = 1;
    t.references = {0};
    // Each inner node has a leaf above its plane and the next inner node below it.
    float plane = 1;
    for (int i = 0; i < depth; ++i) {
      const uint32_t self = uint32_t(t.nodes.size()) - (i == 0 ? 0 : 2);
      const uint32_t child = 2 * uint32_t(i) + 1;
      plane *= 0.5f;
      if (i == 0) t.nodes.push_back(Tree::inner(child, 0, plane));
      else t.nodes[self] = Tree::inner(child, 0, plane);
      t.nodes.push_back(Tree::leaf(0, 1));
      t.nodes.push_back(Tree::leaf(0, 1));
    }
    if (depth == 48) {
      GPURT_EXPECT_OK(gpurt_scene_import_tree(scene, t.get()));
      commit(scene);
      EXPECT_EQ(facts_of(scene).tree_depth, 48u);
      EXPECT_EQ(trace_closest(scene, {ray_at_triangle()})[0].primitive, 0u);
    } else {
      expect_invalid("children at depth 49", "import",
                     [&] { return gpurt_scene_import_tree(scene, t.get()); });
    }
  }
}

TEST(TreeExchange, RefusesArraysThatAreTooSmall)
{
  const Device device = make_device();
  const Scene scene = make_scene(device);
  gpurt_kdtree d = GPURT_KDTREE_INIT;
  expect_invalid("never committed", "export", [&] { return gpurt_scene_export_tree(scene, &d); });
  add_mesh(scene, icosphere(2));
  commit(scene);
  GPURT_ASSERT_OK(gpurt_scene_export_tree(scene, &d));
  std::vector<gpurt_kdtree_node> nodes(d.num_nodes);
  std::vector<uint32_t> references(d.num_references);
  d.nodes = nodes.data();
  d.references = references.data();
  d.num_nodes--;
  const uint64_t capacity = d.num_nodes;
  expect_invalid("room", "export", [&] { return gpurt_scene_export_tree(scene, &d); });
  EXPECT_EQ(d.num_nodes, capacity) << "a failed call wrote its output";
  d.num_nodes++;
  d.references = nullptr;
  expect_invalid("references is NULL", "export", [&] { return gpurt_scene_export_tree(scene, &d); });
  commit(scene, GPURT_ACCEL_EMBREE);
  d = GPURT_KDTREE_INIT;
  expect_invalid("", "export", [&] { return gpurt_scene_export_tree(scene, &d); });
}

TEST(CudaHeader, NeedsACudaDevice)
{
  const Device device = make_device();
  const Scene scene = make_triangle_scene(device);
  const gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  expect_failure(GPURT_ERROR_UNSUPPORTED, "gpurt_scene_trace", "cuda_trace",
                 [&] { return gpurt_cuda_trace(scene, &desc, nullptr, nullptr, nullptr); });
  expect_failure(GPURT_ERROR_UNSUPPORTED, "no streams", "cuda_order",
                 [&] { return gpurt_cuda_order(device, 0, nullptr, nullptr); });
  expect_failure(GPURT_ERROR_UNSUPPORTED, "no streams", "cuda_wait",
                 [&] { return gpurt_cuda_wait(device, 0, nullptr); });
}

}  // namespace
