// Scenes of surfaces that blend.
#pragma once

#include "reyes_pictures.h"

namespace gpurt_test {

inline uint32_t add_pane(gpurt_scene scene, std::array<float, 3> color, float alpha,
                         gpurt_material_type type = GPURT_MATERIAL_LAMBERT)
{
  gpurt_material_desc desc = GPURT_MATERIAL_DESC_INIT;
  desc.type = type;
  desc.alpha = alpha;
  desc.blends = 1;
  desc.roughness = 0.4f;
  std::memcpy(desc.base_color, color.data(), sizeof desc.base_color);
  uint32_t id = 0;
  GPURT_EXPECT_OK(gpurt_scene_add_material(scene, &desc, &id));
  return id;
}

inline void add_sun(gpurt_scene scene)
{
  gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
  light.type = GPURT_LIGHT_DISTANT;
  for (float &c : light.intensity) c = 2;
  light.direction[0] = 0.5f;
  light.direction[1] = -1;
  light.direction[2] = -0.7f;
  uint32_t id;
  GPURT_EXPECT_OK(gpurt_scene_add_light(scene, &light, &id));
}

// Dented shells that blend, some in the same place, around and before one that does not: patches alone.
inline void add_shells(gpurt_scene scene, bool has_opaque)
{
  const std::array<float, 12> small = {0.6f, 0, 0, 0.3f, 0, 0.6f, 0, 0.2f, 0, 0, 0.6f, 0},
                              whole = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  const std::vector<PatchNet> nets = closed_patches(2, 0.3, 5);
  add_patches(scene, nets, add_pane(scene, {0.9f, 0.5f, 0.1f}, 0.4f, GPURT_MATERIAL_METAL), {whole});
  add_patches(scene, nets, add_pane(scene, {0.1f, 0.5f, 0.9f}, 0.7f), {whole, small});
  std::vector<PatchNet> twice = closed_patches(1, 0.1, 7);
  const std::vector<PatchNet> once = twice;
  twice.insert(twice.end(), once.begin(), once.end());
  add_patches(scene, twice, add_pane(scene, {0.1f, 0.9f, 0.2f}, 0.15f),
              {{0.4f, 0, 0, -0.8f, 0, 0.4f, 0, 0.5f, 0, 0, 0.4f, 1}});
  if (has_opaque) {
    add_patches(scene, once, add_material(scene, GPURT_MATERIAL_LAMBERT, {0.8f, 0.8f, 0.8f}),
                {{0.5f, 0, 0, -0.2f, 0, 0.5f, 0, -0.3f, 0, 0, 0.5f, 0.4f}});
    add_patches(scene, {flat_patch({-50, -1.1f, -50}, {100, 0, 0}, {0, 0, 100})});
  }
  add_sun(scene);
  add_camera(scene, {0, 0.3f, 3.5f}, 1.0f);
  std::mt19937_64 rng(4);
  add_turned_camera(scene, {0.1, 0.1, 0.05}, rng, 2.2f);
}
inline void fill_shells(gpurt_scene scene) { add_shells(scene, true); }
inline void fill_bare_shells(gpurt_scene scene) { add_shells(scene, false); }

// The same, with a lamp's worth of sky, balls of triangles and a sheet through the eye.
inline void fill_shells_and_meshes(gpurt_scene scene)
{
  add_shells(scene, true);
  const uint32_t glass = add_pane(scene, {0.9f, 0.9f, 1}, 0.3f, GPURT_MATERIAL_GLASS);
  add_mesh(scene, icosphere(2).map([](std::array<float, 3> v) {
    return std::array<float, 3>{v[0] * 0.3f + 0.8f, v[1] * 0.3f - 0.2f, v[2] * 0.3f + 1.2f};
  }),
           glass);
  add_mesh(scene, quad({-4, 0.5f, -4}, {-4, 0.5f, 4}, {4, -0.2f, 4}, {4, -0.2f, -4}), glass);
  add_patches(scene, {flat_patch({-30, 0.299f, -30}, {60, 0, 0}, {0, 0, 60})}, glass);
  set_environment(scene, 1);
}

// Sheets one behind the other, in no order.
template <int num, int thousandths>
void fill_sheets(gpurt_scene scene)
{
  Random random(6);
  std::vector<uint32_t> order(num);
  for (int i = 0; i < num; ++i) order[size_t(i)] = uint32_t(i);
  for (uint32_t i = num; i > 1; --i) std::swap(order[i - 1], order[random.below(i)]);
  const float alpha = float(thousandths) / 1000;
  const uint32_t panes[] = {add_pane(scene, {0.9f, 0.5f, 0.1f}, alpha),
                            add_pane(scene, {0.1f, 0.5f, 0.9f}, alpha)};
  Mesh sheets[2];
  for (const uint32_t i : order) {
    const float z = -2 * float(i) / num;
    sheets[i % 2].append(quad({-3, -3, z}, {3, -3, z}, {3, 3, z}, {-3, 3, z}));
  }
  for (int k = 0; k < 2; ++k) add_mesh(scene, sheets[k], panes[k]);
  add_sun(scene);
  add_camera(scene, {0, 0, 3}, 0.8f);
}

// Images in little more memory than a commit takes: there is room for few fragments. Returns the least working memory.
template <class Fill>
uint64_t shrink_memory(const Fill &fill, const ReyesPicture &p, const std::vector<OutputBits> &bits,
                       uint64_t lost, const std::vector<uint64_t> &kibibytes)
{
  const auto peak = [](gpurt_device device) {
    gpurt_device_properties properties = GPURT_DEVICE_PROPERTIES_INIT;
    GPURT_EXPECT_OK(gpurt_device_get_properties(device, &properties));
    return properties.memory_peak_bytes;
  };
  const Device roomy = make_device(GPURT_DEVICE_CUDA);
  const Scene whole = scene_of(roomy, fill);
  const uint64_t committed = peak(roomy);
  uint64_t least = UINT64_MAX;
  for (const uint64_t more : kibibytes) {
    SCOPED_TRACE(more);
    const uint64_t limit = committed + (more << 10);
    const Device tight = make_device(GPURT_DEVICE_CUDA, 0, limit);
    const Scene scene = scene_of(tight, fill);
    const Frame frame = frame_of(scene, p);
    gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
    desc.pipeline = GPURT_PIPELINE_REYES;
    desc.samples_per_pixel = p.options.spp;
    desc.max_depth = p.options.max_depth;
    desc.reyes = p.options.reyes;
    Job job;
    GPURT_EXPECT_OK(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()));
    const gpurt_result result = gpurt_job_wait(job, GPURT_WAIT_FOREVER);
    if (result == GPURT_ERROR_OUT_OF_MEMORY) break;
    GPURT_EXPECT_OK(result);
    if (result != GPURT_OK) break;
    expect_same(bits, read_all(frame, p.options));
    EXPECT_LE(peak(tight), limit);
    EXPECT_EQ(statistics(frame).reyes_counters.num_lost_fragments, lost);
    least = statistics(frame).reyes_counters.working_bytes;
  }
  std::printf("%.1f MiB were enough\n", double(least) / (1 << 20));
  return least;
}

}  // namespace gpurt_test
