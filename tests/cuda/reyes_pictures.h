// Pictures of REYES, and their bits on two devices.
#pragma once

#include "../support/patch_shapes.h"
#include "pictures.h"

namespace gpurt_test {

struct ReyesPicture {
  RenderOptions options;
  uint32_t camera = 0;
};

inline ReyesPicture reyes_picture(uint32_t width, uint32_t height, uint32_t spp, float shading_rate = 0,
                                  gpurt_reyes_filter filter = GPURT_REYES_FILTER_AUTO, uint32_t camera = 0)
{
  ReyesPicture p;
  p.options.width = width;
  p.options.height = height;
  p.options.spp = spp;
  p.options.seed = 42;
  p.options.max_depth = 2;
  p.options.pipeline = GPURT_PIPELINE_REYES;
  p.options.reyes.shading_rate = shading_rate;
  p.options.reyes.filter = filter;
  p.camera = camera;
  return p;
}

inline Frame frame_of(gpurt_scene scene, const ReyesPicture &p)
{
  gpurt_frame_desc desc = GPURT_FRAME_DESC_INIT;
  desc.width = p.options.width;
  desc.height = p.options.height;
  desc.camera = p.camera;
  desc.seed = p.options.seed;
  desc.outputs = all_outputs;
  Frame frame;
  GPURT_EXPECT_OK(gpurt_frame_create(scene, &desc, frame.out()));
  return frame;
}

inline std::vector<OutputBits> bits_of(gpurt_scene scene, const ReyesPicture &p,
                                       gpurt_statistics *facts = nullptr)
{
  const Frame frame = frame_of(scene, p);
  render(frame, p.options);
  if (facts != nullptr) *facts = statistics(frame);
  return read_all(frame, p.options);
}

// The same scene on two devices: whole, and in odd tiles on the second one.
inline void compare(gpurt_scene expected, gpurt_scene tested, const ReyesPicture &p)
{
  gpurt_statistics s = GPURT_STATISTICS_INIT, t = GPURT_STATISTICS_INIT;
  const std::vector<OutputBits> bits = bits_of(expected, p, &s);
  expect_same(bits, bits_of(tested, p, &t));
  EXPECT_EQ(t.num_samples, s.num_samples);
  // Rays that can find no light are traced by some devices alone.
  if (p.options.reyes.no_shadows == 0) {
    EXPECT_EQ(t.num_shadow_rays, s.num_shadow_rays);
  }
  EXPECT_EQ(t.num_nonfinite, s.num_nonfinite);
  EXPECT_EQ(t.largest_sample, s.largest_sample);
  EXPECT_EQ(t.reyes_counters.num_shaded, s.reyes_counters.num_shaded);
  EXPECT_EQ(t.reyes_counters.num_lost_fragments, s.reyes_counters.num_lost_fragments);
  ReyesPicture cut = p;
  cut.options.tile_size = 29;
  const uint32_t x = p.options.width / 3, y = p.options.height / 2;
  cut.options.tiles = {
      {x, 0, p.options.width, y}, {0, 0, x, p.options.height}, {x, y, p.options.width, p.options.height}};
  expect_same(bits, bits_of(tested, cut));
}

template <class Fill>
Scene scene_of(gpurt_device device, const Fill &fill)
{
  Scene scene;
  GPURT_EXPECT_OK(gpurt_scene_create(device, scene.out()));
  fill(scene);
  gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
  build.accel = GPURT_ACCEL_BVH;
  build.patch_tolerance = 0.01f;
  GPURT_EXPECT_OK(gpurt_scene_commit(scene, &build));
  return scene;
}

template <class Fill>
void compare_devices(gpurt_device reference, gpurt_device tested, const Fill &fill,
                     const std::vector<ReyesPicture> &pictures)
{
  const Scene a = scene_of(reference, fill), b = scene_of(tested, fill);
  for (const ReyesPicture &p : pictures) {
    SCOPED_TRACE(testing::Message() << "camera " << p.camera << ", shading rate "
                                    << p.options.reyes.shading_rate << ", filter " << p.options.reyes.filter);
    compare(a, b, p);
  }
}

}  // namespace gpurt_test
