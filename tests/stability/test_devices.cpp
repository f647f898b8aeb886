// Row 50: the GPU gives the bits of the CPU.
#include "catalogue.h"

namespace {

using namespace gpurt_test;

class Devices : public Stability {};
INSTANTIATE_TEST_SUITE_P(Methods, Devices, ::testing::ValuesIn([] {
                           std::vector<Method> cuda;
                           for (const Method &m : methods()) {
                             if (m.is_cuda()) cuda.push_back(m);
                           }
                           return cuda;
                         }()),
                         [](const auto &info) { return std::string(info.param.name); });

TEST_P(Devices, Row50CpuAgainstGpu)
{
  const Device cpu = make_device(GPURT_DEVICE_CPU);
  uint64_t bad = 0, total = 0;
  for (const std::string &kind : mesh_kinds) {
    const Mesh mesh = mesh_of_kind(kind).mesh;
    Scene scenes[2];
    for (int i = 0; i < 2; ++i) {
      GPURT_ASSERT_OK(gpurt_scene_create(i == 0 ? cpu : device_, scenes[i].out()));
      const uint32_t grey = add_material(scenes[i], GPURT_MATERIAL_LAMBERT, {0.7f, 0.6f, 0.5f});
      add_mesh(scenes[i], mesh, grey);
      // Shared geometry too: the way through instances has rounding of its own.
      const Bounds b = bounds_of(mesh);
      const Point centre = b.centre();
      const uint32_t ball = add_mesh(scenes[i], icosphere(3), grey, false);
      for (const double turn : {1.0, 2.0}) {
        const float c = float(0.2 * b.extent() * std::cos(turn)),
                    s = float(0.2 * b.extent() * std::sin(turn));
        const float rows[12] = {c, 0, s, centre[0] + 2 * c, 0, s, 0, centre[1] + 2 * s, -s, 0, c, centre[2]};
        gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
        instance.geometry = ball;
        std::copy_n(rows, 12, instance.transform);
        uint32_t id;
        GPURT_ASSERT_OK(gpurt_scene_add_instance(scenes[i], &instance, &id));
      }
      set_environment(scenes[i], 1);
      add_camera(scenes[i], {centre[0], centre[1], centre[2] + 1.5f * b.extent()}, 1);
      commit_scene(scenes[i]);
    }
    Scene kd_tree;
    GPURT_ASSERT_OK(gpurt_scene_create(cpu, kd_tree.out()));
    add_mesh(kd_tree, mesh);
    commit(kd_tree);
    RaySource source(mesh, split_planes(exported_nodes(kd_tree)), 50);
    std::vector<gpurt_ray> rays;
    for (uint64_t i = 0; i < count(80000, 1000000); ++i) rays.push_back(source(RayKind(i % 8)));
    std::vector<uint64_t> offsets[2];
    std::vector<gpurt_hit> all[2], closest[2];
    std::vector<float> images[2];
    RenderOptions o;
    o.spp = 4;
    for (int i = 0; i < 2; ++i) {
      closest[i] = trace_closest(scenes[i], rays);
      all[i] = trace_all(scenes[i], rays, offsets[i]);
      const Frame frame = make_frame(scenes[i], o);
      render(frame, o);
      images[i] = read_color(frame, o);
    }
    for (size_t i = 0; i < rays.size(); ++i)
      bad += std::memcmp(&closest[0][i], &closest[1][i], sizeof(gpurt_hit)) != 0;
    bad += offsets[0] != offsets[1];
    for (size_t i = 0; i < std::min(all[0].size(), all[1].size()); ++i) {
      bad += std::memcmp(&all[0][i], &all[1][i], sizeof(gpurt_hit)) != 0;
    }
    for (size_t i = 0; i < images[0].size(); ++i)
      bad += std::memcmp(&images[0][i], &images[1][i], sizeof(float)) != 0;
    total += rays.size() + all[0].size() + images[0].size();
  }
  record(50, method(), bad, total);
}

}  // namespace
