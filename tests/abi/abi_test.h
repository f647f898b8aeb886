// What the ABI tests share beside support/gpurt_test.h.
#pragma once

#include <functional>

#include "../support/gpurt_test.h"

namespace gpurt_test {

using Buffer = Owned<gpurt_buffer, gpurt_buffer_release>;

inline Scene make_scene(gpurt_device device)
{
  Scene scene;
  GPURT_EXPECT_OK(gpurt_scene_create(device, scene.out()));
  return scene;
}

/// A unit triangle in the plane z = 0, a camera before it, light from everywhere; committed.
inline Scene make_triangle_scene(gpurt_device device, gpurt_accel accel = GPURT_ACCEL_KDTREE)
{
  Scene scene = make_scene(device);
  add_mesh(scene, {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}});
  add_camera(scene, {0.25f, 0.25f, 2}, 0.8f);
  set_environment(scene, 1);
  commit(scene, accel);
  return scene;
}

/// Through the inside of that triangle, at t = 1.
inline gpurt_ray ray_at_triangle() { return {{0.25f, 0.25f, 1}, 0, {0, 0, -1}, 100}; }

/// The device and all that hangs on it. Members are released from the last to the first.
struct World {
  Device device = make_device(GPURT_DEVICE_CPU, 2);
  Scene scene = make_triangle_scene(device);
  Frame frame = make_frame(scene, {8, 8, 1});
  Buffer buffer = make_buffer(device, 64);
  Job job = submit(frame);

  static Buffer make_buffer(gpurt_device device, uint64_t bytes)
  {
    gpurt_buffer_desc desc = GPURT_BUFFER_DESC_INIT;
    desc.size_bytes = bytes;
    Buffer buffer;
    GPURT_EXPECT_OK(gpurt_buffer_create(device, &desc, buffer.out()));
    return buffer;
  }
  static Job submit(gpurt_frame frame)
  {
    gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
    desc.samples_per_pixel = 1;
    Job job;
    GPURT_EXPECT_OK(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()));
    GPURT_EXPECT_OK(gpurt_job_wait(job, GPURT_WAIT_FOREVER));
    return job;
  }
};

/// Expects a failure that sets the last error to a text with `part` in it.
inline void expect_failure(gpurt_result wanted, const std::string &part, const std::string &what,
                           const std::function<gpurt_result()> &call)
{
  // A known failure first: a call that forgets to set its text is found out.
  ASSERT_EQ(gpurt_device_enumerate(nullptr, 0, nullptr), GPURT_ERROR_INVALID_ARGUMENT);
  const std::string before = gpurt_last_error();
  const gpurt_result result = call();
  const std::string text = gpurt_last_error();
  EXPECT_STREQ(gpurt_result_name(result), gpurt_result_name(wanted)) << what << ": " << text;
  EXPECT_NE(text.find(part), std::string::npos) << what << ": " << text;
  if (part != before) {
    EXPECT_NE(text, before) << what;
  }
}
inline void expect_invalid(const std::string &part, const std::string &what,
                           const std::function<gpurt_result()> &call)
{
  expect_failure(GPURT_ERROR_INVALID_ARGUMENT, part, what, call);
}

}  // namespace gpurt_test
