/* Cancels a render, goes on with it later, and gets the same bits as from a render that was left alone. */
#include <string.h>

#include "room.h"

enum { width = 48, height = 48, samples = 64 };

static gpurt_job submit(gpurt_frame frame)
{
  gpurt_render_desc render = GPURT_RENDER_DESC_INIT;
  render.samples_per_pixel = samples; /* in all, not in addition */
  gpurt_job job;
  CHECK(gpurt_frame_submit(frame, &render, NULL, 0, &job));
  return job;
}

static uint64_t samples_done(gpurt_frame frame)
{
  gpurt_statistics statistics = GPURT_STATISTICS_INIT;
  CHECK(gpurt_frame_get_statistics(frame, &statistics));
  return statistics.num_samples;
}

int main(void)
{
  gpurt_device device;
  CHECK(gpurt_device_create(NULL, &device));
  gpurt_scene scene = create_room(device);
  gpurt_frame_desc desc = GPURT_FRAME_DESC_INIT;
  desc.width = width;
  desc.height = height;
  gpurt_frame interrupted, whole;
  CHECK(gpurt_frame_create(scene, &desc, &interrupted));
  CHECK(gpurt_frame_create(scene, &desc, &whole));

  /* Start, let some of it happen, and stop. */
  gpurt_job job = submit(interrupted);
  double share = 0;
  while (share < 0.1) {
    gpurt_result result = gpurt_job_wait(job, 1000 * 1000); /* a millisecond */
    if (result != GPURT_ERROR_TIMEOUT) CHECK(result);
    CHECK(gpurt_job_get_progress(job, &share));
  }
  CHECK(gpurt_job_cancel(job));
  gpurt_result result = gpurt_job_wait(job, GPURT_WAIT_FOREVER);
  if (result != GPURT_ERROR_CANCELLED) CHECK(result); /* it may have been done already */
  gpurt_job_release(job);
  printf("%s after %llu of %d samples\n", result == GPURT_OK ? "done" : "cancelled",
         (unsigned long long)samples_done(interrupted), width * height * samples);

  /* The frame keeps what it has. The same request again does what is left. */
  job = submit(interrupted);
  CHECK(gpurt_job_wait(job, GPURT_WAIT_FOREVER));
  gpurt_job_release(job);
  EXPECT(samples_done(interrupted) == (uint64_t)width * height * samples);

  job = submit(whole);
  CHECK(gpurt_job_wait(job, GPURT_WAIT_FOREVER));
  gpurt_job_release(job);
  static float image[2][height][width][3];
  CHECK(gpurt_frame_read(interrupted, GPURT_OUTPUT_COLOR, image[0], sizeof image[0]));
  CHECK(gpurt_frame_read(whole, GPURT_OUTPUT_COLOR, image[1], sizeof image[1]));
  EXPECT(memcmp(image[0], image[1], sizeof image[0]) == 0);
  printf("the image has the same bits as one rendered at once\n");

  gpurt_frame_release(interrupted);
  gpurt_frame_release(whole);
  gpurt_scene_release(scene);
  gpurt_device_release(device);
  return 0;
}
