// Wall time of whole frames, as a caller waits for them: created, rendered, read, released. One JSON line a case.
//
//   bench_frames [--device cpu|cuda] [--scene FILE] [--pipeline path|reyes] [--size WxH]... [--spp N] [--repeats N]
//                [--keep 0|1] [--pinned 0|1] [--shading samples|micropolygons]
//
// Without a scene: a grid of triangles under a point light, made here. Each frame is a new one; with keep, samples of one frame
// are continued. Its colour is read to the host, into page-locked memory where pinned is 1. "frame_ms" is all of it,
// "device_ms" what the stages of its render took on the device. The first two frames are not counted; the rest are medians.
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include "check.h"
#include "gpurt.h"
#ifdef GPURT_BENCH_CUDA
#include <cuda_runtime_api.h>
#endif

namespace {

struct Size {
  uint32_t width, height;
};

struct Options {
  bool is_cuda = true, is_reyes = false, keeps = false, is_pinned = false;
  std::string scene;
  std::vector<Size> sizes;
  uint32_t spp = 1, repeats = 21;
  gpurt_reyes_shading shading = GPURT_REYES_SHADING_SAMPLES;
};

Options parse(int argc, char **argv)
{
  Options o;
  for (int i = 1; i < argc; i += 2) {
    const std::string name = argv[i], value = i + 1 < argc ? argv[i + 1] : "";
    Size size{};
    if (name == "--device") o.is_cuda = value == "cuda";
    else if (name == "--scene") o.scene = value;
    else if (name == "--pipeline") o.is_reyes = value == "reyes";
    else if (name == "--size" && std::sscanf(value.c_str(), "%ux%u", &size.width, &size.height) == 2)
      o.sizes.push_back(size);
    else if (name == "--spp") o.spp = uint32_t(std::max(1, std::atoi(value.c_str())));
    else if (name == "--repeats") o.repeats = uint32_t(std::max(1, std::atoi(value.c_str())));
    else if (name == "--keep") o.keeps = value == "1";
    else if (name == "--pinned") o.is_pinned = value == "1";
    else if (name == "--shading") {
      o.shading = value == "micropolygons" ? GPURT_REYES_SHADING_MICROPOLYGONS : GPURT_REYES_SHADING_SAMPLES;
    } else {
      std::fprintf(stderr, "error: unknown option %s %s\n", name.c_str(), value.c_str());
      std::exit(2);
    }
  }
  if (o.sizes.empty()) o.sizes = {{512, 512}, {1920, 1080}};
  return o;
}

void fill(gpurt_scene scene)
{
  constexpr uint32_t n = 100;
  std::vector<float> positions;
  std::vector<uint32_t> indices;
  for (uint32_t k = 0; k < (n + 1) * (n + 1); ++k) {
    const uint32_t x = k % (n + 1), y = k / (n + 1);
    positions.insert(positions.end(),
                     {4 * float(x) / n - 2, 4 * float(y) / n - 2, 0.2f * float((x * 7 + y * 3) % 5) - 3});
    if (x == n || y == n) continue;
    indices.insert(indices.end(), {k, k + 1, k + n + 1, k + 1, k + n + 2, k + n + 1});
  }
  gpurt_mesh_desc triangles = GPURT_MESH_DESC_INIT;
  triangles.vertices.data = positions.data();
  triangles.vertices.count = positions.size() / 3;
  triangles.indices.data = indices.data();
  triangles.indices.count = indices.size() / 3;
  uint32_t id = 0;
  gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
  check(gpurt_scene_add_mesh(scene, &triangles, &instance.geometry), "gpurt_scene_add_mesh");
  check(gpurt_scene_add_instance(scene, &instance, &id), "gpurt_scene_add_instance");
  gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
  for (float &c : light.intensity) c = 10;
  light.position[0] = 1;
  check(gpurt_scene_add_light(scene, &light, &id), "gpurt_scene_add_light");
  gpurt_camera_desc camera = GPURT_CAMERA_DESC_INIT;
  check(gpurt_scene_add_camera(scene, &camera, &id), "gpurt_scene_add_camera");
}

// Room for a frame's colour.
class Pixels {
 public:
  Pixels(const Size &size, bool is_pinned) : bytes_(uint64_t(size.width) * size.height * 3 * sizeof(float))
  {
#ifdef GPURT_BENCH_CUDA
    if (is_pinned && cudaMallocHost(&pinned_, bytes_) == cudaSuccess) return;
#endif
    if (is_pinned) {
      std::fprintf(stderr, "error: --pinned 1 takes a CUDA device\n");
      std::exit(1);
    }
    pageable_.assign(bytes_ / sizeof(float), 0.0f);
  }
  void *data() { return pinned_ != nullptr ? pinned_ : pageable_.data(); }
  uint64_t bytes() const { return bytes_; }

 private:
  uint64_t bytes_;
  void *pinned_ = nullptr;  // goes with the process
  std::vector<float> pageable_;
};

void run(gpurt_device device, gpurt_scene scene, const Size &size, const Options &o)
{
  struct {
    const char *name;
    std::vector<double> seconds;
  } parts[] = {{"frame_ms", {}},   {"create_ms", {}}, {"render_ms", {}}, {"read_ms", {}},
               {"release_ms", {}}, {"device_ms", {}}, {"job_ms", {}},    {"film_ms", {}}};
  Pixels pixels(size, o.is_pinned);
  gpurt_frame frame = nullptr;
  for (uint32_t i = 0; i < o.repeats + 2; ++i) {
    const double start = now();
    if (frame == nullptr) {
      gpurt_frame_desc frame_desc = GPURT_FRAME_DESC_INIT;
      frame_desc.width = size.width;
      frame_desc.height = size.height;
      frame_desc.outputs = 1u << GPURT_OUTPUT_COLOR;
      check(gpurt_frame_create(scene, &frame_desc, &frame), "gpurt_frame_create");
    }
    const double created = now();
    gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
    desc.pipeline = o.is_reyes ? GPURT_PIPELINE_REYES : GPURT_PIPELINE_PATH;
    desc.samples_per_pixel = o.keeps ? o.spp * (i + 1) : o.spp;
    if (o.is_reyes) {
      desc.reyes.no_shadows = 1;
      desc.reyes.shading = o.shading;
    }
    gpurt_job job = nullptr;
    check(gpurt_frame_submit(frame, &desc, nullptr, 0, &job), "gpurt_frame_submit");
    check(gpurt_job_wait(job, GPURT_WAIT_FOREVER), "gpurt_job_wait");
    check(gpurt_job_release(job), "gpurt_job_release");
    const double rendered = now();
    check(gpurt_frame_read(frame, GPURT_OUTPUT_COLOR, pixels.data(), pixels.bytes()), "gpurt_frame_read");
    const double read = now();
    // Not part of a frame: few ask for statistics of every one.
    gpurt_statistics s = GPURT_STATISTICS_INIT;
    if (!o.keeps) check(gpurt_frame_get_statistics(frame, &s), "gpurt_frame_get_statistics");
    const double releasing = now();
    if (!o.keeps) {
      gpurt_frame_release(frame);
      frame = nullptr;
    }
    const double end = now();
    if (i < 2) continue;
    const gpurt_reyes_counters &c = s.reyes_counters;
    const double on_device = s.generate_seconds + s.trace_seconds + s.shade_seconds + s.shadow_seconds +
                             c.bound_seconds + c.split_seconds + c.dice_seconds + c.sample_seconds;
    const double seconds[] = {end - start - (releasing - read),
                              created - start,
                              rendered - created,
                              read - rendered,
                              end - releasing,
                              on_device,
                              s.render_seconds,
                              s.film_seconds};
    for (size_t k = 0; k < std::size(parts); ++k) parts[k].seconds.push_back(seconds[k]);
  }
  if (frame != nullptr) gpurt_frame_release(frame);
  gpurt_device_properties properties = GPURT_DEVICE_PROPERTIES_INIT;
  check(gpurt_device_get_properties(device, &properties), "gpurt_device_get_properties");
  const std::string name = o.scene.empty() ? "grid" : o.scene.substr(o.scene.find_last_of('/') + 1);
  std::printf(
      "{\"bench\":\"frames\",\"device\":\"%s\",\"scene\":\"%s\",\"pipeline\":\"%s\",\"width\":%u,\"height\":%"
      "u,"
      "\"spp\":%u,\"shading\":%d,\"keep\":%d,\"pinned\":%d",
      properties.name, name.c_str(), o.is_reyes ? "reyes" : "path", size.width, size.height, o.spp,
      int(o.shading), int(o.keeps), int(o.is_pinned));
  for (const auto &part : parts) {
    // A frame that is kept has statistics of all its jobs together.
    const std::string part_name = part.name;
    if (o.keeps && (part_name == "device_ms" || part_name == "job_ms" || part_name == "film_ms")) continue;
    std::printf(",\"%s\":%.4f", part.name, median(part.seconds) * 1e3);
  }
  std::printf("}\n");
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char **argv)
{
  const Options o = parse(argc, argv);
  gpurt_device device = nullptr;
  gpurt_device_desc desc = GPURT_DEVICE_DESC_INIT;
  desc.type = o.is_cuda ? GPURT_DEVICE_CUDA : GPURT_DEVICE_CPU;
  check(gpurt_device_create(&desc, &device), "gpurt_device_create");
  gpurt_scene scene = nullptr;
  if (o.scene.empty()) {
    check(gpurt_scene_create(device, &scene), "gpurt_scene_create");
    fill(scene);
  } else {
    check(gpurt_scene_load(device, o.scene.c_str(), &scene), "gpurt_scene_load");
  }
  gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
  build.accel = GPURT_ACCEL_BVH;
  check(gpurt_scene_commit(scene, &build), "gpurt_scene_commit");
  for (const Size &size : o.sizes) run(device, scene, size, o);
  gpurt_scene_release(scene);
  gpurt_device_release(device);
}
