// Time and memory of acceleration structures.
//
//   bench_build [--threads N] [--repeats N] SCENE...
//
// SCENE is a glTF file or bumps:N; without one, bumps of 250 thousand and a million triangles are built. Methods take
// turns, so that a disturbance of the machine hits all of them; ratios are to Embree's own build in the same run.
#include <algorithm>
#include <chrono>
#include <cstring>
#include <thread>

#include "embree_reference.h"
#include "gpurt_scene.h"

namespace {

double now()
{
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

struct Samples {
  std::vector<double> seconds;
  double quantile(double q) const
  {
    std::vector<double> s = seconds;
    std::sort(s.begin(), s.end());
    return s[size_t(q * double(s.size() - 1) + 0.5)];
  }
};

void print(const char *method, const bench::TriangleScene &scene, uint32_t threads, const char *isa,
           const Samples &build, const Samples &reference, const gpurt_scene_facts *facts)
{
  std::printf(
      "{\"bench\":\"build\",\"method\":\"%s\",\"scene\":\"%s\",\"triangles\":%zu,\"threads\":%u,\"isa\":\"%"
      "s\","
      "\"seconds_median\":%.6f,\"seconds_min\":%.6f,\"seconds_max\":%.6f,\"ratio_to_embree\":%.3f",
      method, scene.name.c_str(), scene.triangles.size(), threads, isa, build.quantile(0.5),
      build.quantile(0), build.quantile(1), build.quantile(0.5) / reference.quantile(0.5));
  if (facts != nullptr) {
    const double n = double(std::max<size_t>(scene.triangles.size(), 1));
    std::printf(
        ",\"accel_bytes_per_triangle\":%.1f,\"scene_bytes_per_triangle\":%.1f,\"nodes_per_triangle\":%.3f,"
        "\"references_per_triangle\":%.3f,\"depth\":%u,\"sah_cost\":%.3f",
        double(facts->accel_bytes) / n, double(facts->scene_bytes) / n, double(facts->num_nodes) / n,
        double(facts->num_references) / n, facts->tree_depth, facts->sah_cost);
  }
  std::printf("}\n");
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char **argv)
{
  uint32_t threads = std::max(1u, std::thread::hardware_concurrency());
  int repeats = 5;
  std::vector<std::string> scenes;
  for (int i = 1; i < argc; ++i) {
    if (!std::strcmp(argv[i], "--threads") && i + 1 < argc) threads = uint32_t(std::atoi(argv[++i]));
    else if (!std::strcmp(argv[i], "--repeats") && i + 1 < argc) repeats = std::max(1, std::atoi(argv[++i]));
    else scenes.push_back(argv[i]);
  }
  if (scenes.empty()) scenes = {"bumps:250000", "bumps:1000000"};

  gpurt_device device = nullptr;
  gpurt_device_desc desc = GPURT_DEVICE_DESC_INIT;
  desc.type = GPURT_DEVICE_CPU;
  desc.num_threads = threads;
  bench::check(gpurt_device_create(&desc, &device), "creating the device");
  gpurt_device_properties properties = GPURT_DEVICE_PROPERTIES_INIT;
  bench::check(gpurt_device_get_properties(device, &properties), "reading the device");

  for (const std::string &what : scenes) {
    const bench::TriangleScene source = bench::load_scene(what);
    Samples raw, embree, kdtree, bvh;
    gpurt_scene_facts embree_facts = GPURT_SCENE_FACTS_INIT, kdtree_facts = GPURT_SCENE_FACTS_INIT,
                      bvh_facts = GPURT_SCENE_FACTS_INIT;
    for (int r = 0; r <= repeats; ++r) {  // the first round warms up
      Samples sink;
      {
        bench::EmbreeReference reference(source, threads);
        const double t = now();
        reference.build();
        (r == 0 ? sink : raw).seconds.push_back(now() - t);
      }
      // The whole commit: compilation of the scene included.
      bench::GpurtScene scene(device, source);
      double t = now();
      embree_facts = scene.commit(GPURT_ACCEL_EMBREE);
      (r == 0 ? sink : embree).seconds.push_back(now() - t);
      t = now();
      kdtree_facts = scene.commit(GPURT_ACCEL_KDTREE);
      (r == 0 ? sink : kdtree).seconds.push_back(now() - t);
      t = now();
      bvh_facts = scene.commit(GPURT_ACCEL_BVH);
      (r == 0 ? sink : bvh).seconds.push_back(now() - t);
    }
    print("embree_raw", source, threads, properties.instruction_set, raw, raw, nullptr);
    print("gpurt_embree", source, threads, properties.instruction_set, embree, raw, &embree_facts);
    print("gpurt_kdtree", source, threads, properties.instruction_set, kdtree, raw, &kdtree_facts);
    print("gpurt_bvh", source, threads, properties.instruction_set, bvh, raw, &bvh_facts);
  }
  gpurt_device_release(device);
  return 0;
}
