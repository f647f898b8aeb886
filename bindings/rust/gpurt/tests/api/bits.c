/* Writes what rays hit in the room of examples/room.h and what it looks like, as raw bytes; so does bits.rs. */
#include "room.h"

enum { width = 24, height = 18, num_rays = 64 };

static void put(const void *data, size_t size) { EXPECT(fwrite(data, 1, size, stdout) == size); }

int main(void)
{
  gpurt_device_desc device_desc = GPURT_DEVICE_DESC_INIT;
  device_desc.type = GPURT_DEVICE_CPU;
  device_desc.num_threads = 2;
  gpurt_device device;
  CHECK(gpurt_device_create(&device_desc, &device));
  gpurt_scene scene = create_room(device);

  gpurt_ray rays[num_rays];
  for (int i = 0; i < num_rays; ++i) {
    gpurt_ray ray = {{0, 0, 3.6f}, 0.5f, {(float)(i % 8) / 8 - 0.5f, (float)(i / 8) / 8 - 0.5f, -1}, 100};
    rays[i] = ray;
  }
  static gpurt_hit hits[16 * num_rays];
  gpurt_trace_desc trace = GPURT_TRACE_DESC_INIT;
  trace.num_rays = num_rays;
  trace.rays = rays;
  trace.hits = hits;
  CHECK(gpurt_scene_trace(scene, &trace));
  put(hits, num_rays * sizeof *hits);
  uint64_t offsets[num_rays + 1];
  trace.query = GPURT_QUERY_ALL;
  trace.hit_capacity = 16 * num_rays;
  trace.offsets = offsets;
  CHECK(gpurt_scene_trace(scene, &trace));
  put(offsets, sizeof offsets);
  put(hits, offsets[num_rays] * sizeof *hits);

  gpurt_frame_desc frame_desc = GPURT_FRAME_DESC_INIT;
  frame_desc.width = width;
  frame_desc.height = height;
  frame_desc.outputs = 1u << GPURT_OUTPUT_DEPTH | 1u << GPURT_OUTPUT_NORMAL | 1u << GPURT_OUTPUT_PRIMITIVE;
  frame_desc.seed = 3;
  gpurt_render_desc render = GPURT_RENDER_DESC_INIT;
  render.samples_per_pixel = 4;
  render.max_depth = 5;
  const gpurt_tile tiles[2] = {{0, 0, width, 7}, {0, 7, width, height}};
  gpurt_frame frame;
  gpurt_job job;
  CHECK(gpurt_frame_create(scene, &frame_desc, &frame));
  CHECK(gpurt_frame_submit(frame, &render, tiles, 2, &job));
  CHECK(gpurt_job_wait(job, GPURT_WAIT_FOREVER));
  static const struct {
    gpurt_output output;
    size_t channels;
  } outputs[] = {{GPURT_OUTPUT_COLOR, 3},  {GPURT_OUTPUT_ALPHA, 1},     {GPURT_OUTPUT_DEPTH, 1},
                 {GPURT_OUTPUT_NORMAL, 3}, {GPURT_OUTPUT_PRIMITIVE, 1}, {GPURT_OUTPUT_SAMPLE_COUNT, 1}};
  for (int i = 0; i < 6; ++i) {
    static uint32_t data[3 * width * height];
    size_t size = outputs[i].channels * width * height * sizeof *data;
    CHECK(gpurt_frame_read(frame, outputs[i].output, data, size));
    put(data, size);
  }
  return 0;
}
