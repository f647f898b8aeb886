// Frames of REYES, and of path tracing beside it, for tests.
#pragma once

#include "patch_shapes.h"

namespace gpurt_test {

inline RenderOptions reyes_options(uint32_t size, uint32_t spp, float shading_rate = 0)
{
  RenderOptions o;
  o.width = o.height = size;
  o.spp = spp;
  o.pipeline = GPURT_PIPELINE_REYES;
  o.reyes.shading_rate = shading_rate;
  o.reyes.no_shadows = 1;
  o.max_depth = 2;
  return o;
}

inline RenderOptions path_options(const RenderOptions &o)
{
  RenderOptions p = o;
  p.pipeline = GPURT_PIPELINE_PATH;
  p.reyes = GPURT_REYES_SETTINGS_INIT;
  return p;
}

// A light of any type that shines on what is about the origin.
inline void add_light(gpurt_scene scene, gpurt_light_type type, float intensity)
{
  gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
  light.type = type;
  for (float &c : light.intensity) c = intensity;
  light.intensity[2] *= 0.7f;
  light.position[0] = light.position[1] = light.position[2] = 2;
  light.direction[0] = 0.3f;
  light.direction[1] = -0.2f;
  light.direction[2] = -1;
  uint32_t id;
  GPURT_EXPECT_OK(gpurt_scene_add_light(scene, &light, &id));
}

inline Frame camera_frame(gpurt_scene scene, const RenderOptions &o, uint32_t camera, uint32_t outputs = 0)
{
  gpurt_frame_desc desc = GPURT_FRAME_DESC_INIT;
  desc.width = o.width;
  desc.height = o.height;
  desc.camera = camera;
  desc.seed = o.seed;
  desc.outputs = outputs;
  Frame frame;
  GPURT_EXPECT_OK(gpurt_frame_create(scene, &desc, frame.out()));
  return frame;
}

template <class T>
std::vector<T> read_output(gpurt_frame frame, const RenderOptions &o, gpurt_output output, size_t components)
{
  std::vector<T> values(size_t(o.width) * o.height * components);
  GPURT_EXPECT_OK(gpurt_frame_read(frame, output, values.data(), values.size() * sizeof(T)));
  return values;
}

// Coverage is that of the patches: rays may meet something coarser.
inline void coarse_commit(gpurt_scene scene)
{
  gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
  build.accel = GPURT_ACCEL_BVH;
  build.patch_tolerance = 0.01f;
  GPURT_EXPECT_OK(gpurt_scene_commit(scene, &build));
}

// Samples that something covers, pixel by pixel.
inline std::vector<int> covered_samples(gpurt_scene scene, const RenderOptions &o, uint32_t camera)
{
  Frame frame = camera_frame(scene, o, camera);
  render(frame, o);
  std::vector<int> counts;
  for (float a : read_output<float>(frame, o, GPURT_OUTPUT_ALPHA, 1))
    counts.push_back(int(std::lround(a * float(o.spp))));
  return counts;
}

inline gpurt_statistics statistics_of(gpurt_frame frame)
{
  gpurt_statistics s = GPURT_STATISTICS_INIT;
  GPURT_EXPECT_OK(gpurt_frame_get_statistics(frame, &s));
  return s;
}

// Layers that glow red, green, blue, red .. before a white sky.

inline uint32_t add_glow(gpurt_scene scene, std::array<float, 3> emission, float alpha)
{
  gpurt_material_desc desc = GPURT_MATERIAL_DESC_INIT;
  for (size_t k = 0; k < 3; ++k) desc.base_color[k] = 0, desc.emission[k] = emission[k];
  desc.two_sided_emission = 1;
  desc.alpha = alpha;
  desc.blends = alpha < 1;
  uint32_t id = 0;
  GPURT_EXPECT_OK(gpurt_scene_add_material(scene, &desc, &id));
  return id;
}

inline std::array<uint32_t, 3> add_layer_materials(gpurt_scene scene, float alpha)
{
  return {add_glow(scene, {1, 0, 0}, alpha), add_glow(scene, {0, 1, 0}, alpha),
          add_glow(scene, {0, 0, 1}, alpha)};
}

// 0 to num - 1 in no order.
inline std::vector<uint32_t> shuffled_layers(uint32_t num)
{
  std::vector<uint32_t> order(num);
  for (uint32_t i = 0; i < num; ++i) order[i] = i;
  std::mt19937_64 rng(39);
  for (uint32_t i = num; i > 1; --i) std::swap(order[i - 1], order[pick(rng, i)]);
  return order;
}

// What is seen through `num` of them.
inline std::array<double, 3> color_of_layers(uint32_t num, float alpha)
{
  double through = 1;
  std::array<double, 3> color = {0, 0, 0};
  for (uint32_t i = 0; i < num; ++i) {
    color[i % 3] += through * double(alpha);
    through *= 1 - double(alpha);
  }
  for (double &c : color) c += through;
  return color;
}

}  // namespace gpurt_test
