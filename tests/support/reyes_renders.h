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

}  // namespace gpurt_test
