// gpurt.hpp: the README's program, ownership and exceptions.
#include "gpurt.hpp"

#include <gtest/gtest.h>

namespace {

gpurt::Scene triangle_scene(const gpurt::Device &device)
{
  gpurt::Scene scene = device.scene();
  scene.add_mesh({0, 0, 0, 1, 0, 0, 0, 1, 0}, {0, 1, 2});
  gpurt_environment_desc environment = GPURT_ENVIRONMENT_DESC_INIT;
  environment.radiance[0] = environment.radiance[1] = environment.radiance[2] = 1;
  scene.set(environment);
  gpurt_camera_desc camera = GPURT_CAMERA_DESC_INIT;
  camera.transform[11] = 3;
  camera.width = 6;
  camera.height = 4;
  scene.add(camera);
  scene.commit();
  return scene;
}

TEST(Wrapper, TracesAndRenders)
{
  const gpurt::Device device(GPURT_DEVICE_CPU);
  EXPECT_EQ(device.properties().type, GPURT_DEVICE_CPU);
  EXPECT_GE(gpurt::Device::enumerate().size(), 1u);
  const gpurt::Scene scene = triangle_scene(device);
  const std::vector<gpurt_ray> rays = {{{0.25f, 0.25f, 1}, 0, {0, 0, -1}, 100},
                                       {{5, 5, 1}, 0, {0, 0, -1}, 100}};
  EXPECT_NEAR(scene.trace(rays)[0].t, 1, 1e-6);  // Embree's, not exact
  EXPECT_EQ(scene.trace(rays)[1].primitive, GPURT_INVALID_ID);
  EXPECT_EQ(scene.occluded(rays), (std::vector<uint8_t>{1, 0}));
  const auto all = scene.trace_all(rays);
  EXPECT_EQ(all.offsets, (std::vector<uint64_t>{0, 1, 1}));
  EXPECT_EQ(all.hits.size(), 1u);
  EXPECT_EQ(scene.facts().num_world_triangles, 1u);
  EXPECT_EQ(scene.camera(0).width, 6u);

  const gpurt::Frame frame = scene.frame();
  frame.render(4);
  EXPECT_EQ(frame.width(), 6u);
  EXPECT_EQ(frame.height(), 4u);
  EXPECT_EQ(frame.read(GPURT_OUTPUT_COLOR).size(), 72u);
  EXPECT_EQ(frame.read_ids(GPURT_OUTPUT_SAMPLE_COUNT), std::vector<uint32_t>(24, 4));
  EXPECT_THROW(frame.read(GPURT_OUTPUT_SAMPLE_COUNT), gpurt::Error);
  EXPECT_THROW(frame.read_ids(GPURT_OUTPUT_COLOR), gpurt::Error);
  const gpurt::Job job = frame.submit(8);
  while (!job.wait_for(std::chrono::milliseconds(10))) EXPECT_LE(job.progress(), 1.0);
  EXPECT_EQ(job.progress(), 1.0);
}

TEST(Wrapper, FindsPointsNearPlaces)
{
  const gpurt::Device device(GPURT_DEVICE_CPU);
  const std::vector<float> points = {0, 0, 0, 1, 0, 0, 1, 1, 0, 5, 5, 5}, places = {0, 0.1f, 0, 5, 5, 4.9f};
  const gpurt::PhotonMap map = device.photon_map(points, std::vector<float>(12, 2.0f), 1.2f);
  EXPECT_EQ(map.info().num_points, 4u);
  EXPECT_EQ(map.count(places, 1.2f), (std::vector<uint32_t>{2, 1}));
  EXPECT_EQ(map.sum(places, 1.2f), (std::vector<float>{4, 4, 4, 2, 2, 2}));
  const auto lists = map.list(places, 1.2f);
  EXPECT_EQ(lists.offsets, (std::vector<uint64_t>{0, 2, 3}));
  EXPECT_EQ(lists.ids[2], 3u);
  const auto nearest = map.nearest(places, 3);
  EXPECT_EQ(nearest.counts, (std::vector<uint32_t>{3, 3}));
  EXPECT_EQ(nearest.ids[0], 0u);
  EXPECT_NEAR(nearest.distances[3], 0.1f, 1e-6f);
  const std::string path = testing::TempDir() + "/wrapper.gpurtpm";
  map.save(path);
  EXPECT_EQ(device.load_photon_map(path).count(places, 1.2f), map.count(places, 1.2f));
  std::remove(path.c_str());
  EXPECT_THROW(map.count({1, 2}, 1), gpurt::Error);
  EXPECT_THROW(device.photon_map({1, 2}), gpurt::Error);
}

TEST(Wrapper, TracesPhotonsOfAScene)
{
  const gpurt::Device device(GPURT_DEVICE_CPU);
  const gpurt::Scene scene = device.scene();
  EXPECT_THROW(scene.trace_photons(), gpurt::Error);
  scene.add_mesh({-9, 0, -9, 0, 0, 9, 9, 0, -9}, {0, 1, 2});
  scene.add_mesh({-9, 1, -9, 0, 1, 9, 9, 1, -9}, {0, 1, 2});
  gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
  light.position[1] = 0.5f;
  light.intensity[0] = 1;
  scene.add(light);
  scene.commit();
  const gpurt::PhotonMap map = scene.trace_photons(1000, 7);
  EXPECT_EQ(map.info().num_paths, 1000u);
  EXPECT_GT(map.info().num_points, 500u);
  EXPECT_EQ(map.read(GPURT_PHOTON_ATTRIBUTE_FLUX).size(), 3 * map.info().num_points);
}

TEST(Wrapper, ExceptionsCarryResultAndText)
{
  const gpurt::Device device(GPURT_DEVICE_CPU);
  const gpurt::Scene scene = device.scene();
  try {
    scene.camera(3);
    FAIL() << "no exception";
  } catch (const gpurt::Error &e) {
    EXPECT_EQ(e.result(), GPURT_ERROR_INVALID_ARGUMENT);
    EXPECT_NE(std::string(e.what()).find("camera is 3"), std::string::npos) << e.what();
  }
  EXPECT_THROW(gpurt::Scene().commit(), gpurt::Error);
  EXPECT_THROW(gpurt::array<3>(std::vector<float>(4)), gpurt::Error);
}

TEST(Wrapper, CopiesRetainAndMovesDoNot)
{
  gpurt::Scene scene = triangle_scene(gpurt::Device(GPURT_DEVICE_CPU));
  const gpurt_scene raw = scene.get();
  {
    const gpurt::Scene copy = scene;
    scene.reset();
    EXPECT_FALSE(scene);
    EXPECT_EQ(copy.get(), raw);
    EXPECT_EQ(copy.facts().num_geometries, 1u);
    gpurt::Scene moved = gpurt::Scene(copy);
    scene = std::move(moved);
    EXPECT_FALSE(moved);
  }
  EXPECT_EQ(scene.facts().num_geometries, 1u);
  scene = gpurt::Scene();
  EXPECT_EQ(gpurt_scene_retain(raw), GPURT_ERROR_INVALID_ARGUMENT);
}

TEST(Wrapper, VectorsAreSharedAsBuffers)
{
  const gpurt::Device device(GPURT_DEVICE_CPU);
  const gpurt::Scene scene = device.scene();
  {
    std::vector<float> positions = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    const float *address = positions.data();
    const gpurt::Buffer buffer = device.buffer(std::move(positions));
    EXPECT_EQ(buffer.data(), address);
    EXPECT_EQ(buffer.size_bytes(), 36u);
    gpurt_mesh_desc mesh = GPURT_MESH_DESC_INIT;
    mesh.vertices = buffer.array<std::array<float, 3>>(3);
    gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
    instance.geometry = scene.add(mesh);
    scene.add(instance);
  }
  gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
  build.accel = GPURT_ACCEL_KDTREE;
  scene.commit(build);
  EXPECT_EQ(scene.trace({{{0.25f, 0.25f, 1}, 0, {0, 0, -1}, 100}})[0].primitive, 0u);
  const auto tree = scene.export_tree();
  EXPECT_EQ(tree.num_triangles, 1u);
  scene.import_tree(tree);
  scene.commit(build);
  EXPECT_EQ(scene.trace({{{0.25f, 0.25f, 1}, 0, {0, 0, -1}, 100}})[0].primitive, 0u);
  EXPECT_THROW(device.buffer(std::vector<int>()), gpurt::Error);
}

TEST(Wrapper, HitsLeadToPatches)
{
  const gpurt::Device device(GPURT_DEVICE_CPU);
  const gpurt::Scene scene = device.scene();
  // A flat patch over the unit square: its parameters are x and y.
  std::vector<float> points;
  for (int k = 0; k < 16; ++k) {
    for (const float c : {float(k % 4) / 3, float(k / 4) / 3, 0.0f}) points.push_back(c);
  }
  gpurt_patches_desc patches = GPURT_PATCHES_DESC_INIT;
  patches.control_points = gpurt::array<3>(points);
  gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
  instance.geometry = scene.add(patches);
  scene.add(instance);
  scene.commit();
  const auto found =
      scene.locate(scene.trace({{{0.25f, 0.5f, 1}, 0, {0, 0, -1}, 100}, {{2, 2, 1}, 0, {0, 0, -1}, 100}}));
  EXPECT_EQ(found[0].patch, 0u);
  EXPECT_NEAR(found[0].u, 0.25, 1e-6);
  EXPECT_NEAR(found[0].v, 0.5, 1e-6);
  EXPECT_EQ(found[1].patch, GPURT_INVALID_ID);
}

TEST(Wrapper, DevicesAreNamedByNumber)
{
  const gpurt::Device device(GPURT_DEVICE_CPU, std::vector<uint32_t>{0});
  EXPECT_EQ(device.properties().type, GPURT_DEVICE_CPU);
  EXPECT_THROW(gpurt::Device(GPURT_DEVICE_CPU, {0, 0}), gpurt::Error);
  const gpurt::Buffer buffer = device.buffer(8, GPURT_STORAGE_DEVICE);
  const float values[2] = {1, 2};
  float second = 0;
  buffer.write(values, sizeof values);
  buffer.read(&second, sizeof second, 4);
  EXPECT_EQ(second, 2.0f);
  EXPECT_THROW(buffer.read(&second, 4, 5), gpurt::Error);
}

}  // namespace
