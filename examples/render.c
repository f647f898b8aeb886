/* Renders an image of a glTF file, or of a small room, and saves it with all its outputs.
 *
 *   render [SCENE.glb [SAMPLES]]
 */
#include "room.h"

static void print_message(void *user, gpurt_log_level level, const char *message)
{
  static const char *const names[] = {"", "error", "warning", "info"};
  (void)user;
  if (level <= GPURT_LOG_WARNING) fprintf(stderr, "%s: %s\n", names[level], message);
}

static void print_progress(void *user, double done, double total)
{
  (void)user;
  fprintf(stderr, "\r%3.0f %%", 100 * done / total);
}

int main(int argc, char **argv)
{
  gpurt_device_desc device_desc = GPURT_DEVICE_DESC_INIT;
  device_desc.log = print_message;
  gpurt_device device;
  CHECK(gpurt_device_create(&device_desc, &device));

  gpurt_scene scene;
  if (argc > 1) {
    CHECK(gpurt_scene_load(device, argv[1], &scene));
    CHECK(gpurt_scene_commit(scene, NULL));
  } else {
    scene = create_room(device);
  }

  /* The frame says what image it is and what it keeps of it ... */
  gpurt_frame_desc frame_desc = GPURT_FRAME_DESC_INIT;
  frame_desc.width = argc > 1 ? 0 : 64; /* 0: what the file's camera says */
  frame_desc.height = argc > 1 ? 0 : 48;
  frame_desc.outputs = 1u << GPURT_OUTPUT_DEPTH | 1u << GPURT_OUTPUT_NORMAL | 1u << GPURT_OUTPUT_ALBEDO;
  gpurt_frame frame;
  CHECK(gpurt_frame_create(scene, &frame_desc, &frame));

  /* ... and the render how to get there. */
  gpurt_render_desc render = GPURT_RENDER_DESC_INIT;
  render.samples_per_pixel = argc > 2 ? (uint32_t)strtoul(argv[2], NULL, 10) : 16;
  render.progress = print_progress;
  gpurt_job job;
  CHECK(gpurt_frame_submit(frame, &render, NULL, 0, &job));
  CHECK(gpurt_job_wait(job, GPURT_WAIT_FOREVER));
  fprintf(stderr, "\n");

  gpurt_statistics statistics = GPURT_STATISTICS_INIT;
  CHECK(gpurt_frame_get_statistics(frame, &statistics));
  printf("%u x %u, %llu samples a pixel in %.2f s, estimated relMSE %.2g\n", statistics.width,
         statistics.height, (unsigned long long)statistics.samples_per_pixel, statistics.render_seconds,
         statistics.estimated_error);
  EXPECT(statistics.samples_per_pixel == render.samples_per_pixel && statistics.num_nonfinite == 0);

  CHECK(gpurt_frame_save(frame, "render.exr")); /* float32, every output as a layer */
  CHECK(gpurt_frame_save(frame, "render.png")); /* the colour, tonemapped */
  printf("saved render.exr and render.png\n");

  gpurt_job_release(job);
  gpurt_frame_release(frame);
  gpurt_scene_release(scene);
  gpurt_device_release(device);
  return 0;
}
