/* Splits the samples of an image over two frames, as two machines would, and merges them to the same bits. */
#include <string.h>

#include "room.h"

enum { width = 48, height = 48 };

/* Renders the samples [first, first + count) of every pixel. */
static gpurt_frame render_samples(gpurt_scene scene, uint64_t first, uint32_t count)
{
  gpurt_frame_desc desc = GPURT_FRAME_DESC_INIT;
  desc.width = width;
  desc.height = height;
  desc.seed = 7; /* frames that are merged have one seed, and samples of their own */
  desc.first_sample = first;
  gpurt_render_desc render = GPURT_RENDER_DESC_INIT;
  render.samples_per_pixel = count;
  gpurt_frame frame;
  gpurt_job job;
  CHECK(gpurt_frame_create(scene, &desc, &frame));
  CHECK(gpurt_frame_submit(frame, &render, NULL, 0, &job));
  CHECK(gpurt_job_wait(job, GPURT_WAIT_FOREVER));
  gpurt_job_release(job);
  return frame;
}

int main(void)
{
  gpurt_device device;
  CHECK(gpurt_device_create(NULL, &device));
  gpurt_scene scene = create_room(device);

  gpurt_frame here = render_samples(scene, 0, 10);
  gpurt_frame there = render_samples(scene, 10, 6);

  /* What the other machine has comes as a file with its exact sums. Machines that run the same build on the same
   * kind of device agree to the bit. */
  CHECK(gpurt_frame_save(there, "merge_frames.gpurt"));
  CHECK(gpurt_frame_load_state(here, "merge_frames.gpurt"));
  remove("merge_frames.gpurt");

  /* Samples count once: the same part again is an error, and changes nothing. */
  EXPECT(gpurt_frame_merge(here, there) == GPURT_ERROR_INVALID_ARGUMENT);
  printf("merging twice is refused: %s\n", gpurt_last_error());

  gpurt_frame whole = render_samples(scene, 0, 16);
  static float image[2][height][width][3];
  CHECK(gpurt_frame_read(here, GPURT_OUTPUT_COLOR, image[0], sizeof image[0]));
  CHECK(gpurt_frame_read(whole, GPURT_OUTPUT_COLOR, image[1], sizeof image[1]));
  EXPECT(memcmp(image[0], image[1], sizeof image[0]) == 0);
  printf("10 and 6 samples make the same bits as 16\n");

  gpurt_frame_release(here);
  gpurt_frame_release(there);
  gpurt_frame_release(whole);
  gpurt_scene_release(scene);
  gpurt_device_release(device);
  return 0;
}
