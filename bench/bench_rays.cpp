// Speed of ray queries on a CUDA device for given triangles and rays: device time, rays and compact hits resident. One JSON
// line a case.
//
//   bench_rays SCENE.tris PREFIX [--accel bvh,kdtree] [--repeats N] [--width PIXELS] [--only SET]
//             [--traversal-cost X] [--empty-bonus X] [--fast]
//   bench_rays leaves|rocks|forest [...]
//
// The second form makes scenes with alpha masks and placements, and rays through them (generated_scene.h).
// SCENE.tris is float32 [n][3][3]; PREFIX.SET.rays, with SET primary, ao, diffuse and random, is float32 [m][8] = origin,
// tmin, direction, tmax. ao is answered as any hit, the others as closest hit. Hits of the first accelerator are compared
// with those of every other, bit by bit. The costs are the kd-tree builder's, --fast asks for GPURT_BUILD_QUALITY_FAST.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <string>
#include <thread>
#include <vector>

#include "cuda_check.h"
#include "generated_scene.h"
#include "gpurt.h"
#include "gpurt_cuda.h"

namespace {

template <class T>
std::vector<T> read_file(const std::string &path)
{
  std::FILE *file = std::fopen(path.c_str(), "rb");
  if (file == nullptr) return {};
  std::fseek(file, 0, SEEK_END);
  const long bytes = std::ftell(file);
  std::rewind(file);
  std::vector<T> values(size_t(bytes) / sizeof(T));
  const size_t num_read = std::fread(values.data(), sizeof(T), values.size(), file);
  std::fclose(file);
  if (num_read != values.size()) {
    std::fprintf(stderr, "error: cannot read %s\n", path.c_str());
    std::exit(1);
  }
  return values;
}

struct Options {
  std::string scene, prefix, accels = "bvh,kdtree", only;
  int repeats = 12;
  float traversal_cost = 0, empty_bonus = 0;
  gpurt_build_quality quality = GPURT_BUILD_QUALITY_AUTO;
  uint32_t width = 0;
};

struct Hint {
  const char *name;
  gpurt_coherence coherence;
};
constexpr Hint hints[] = {{"auto", GPURT_COHERENCE_AUTO},
                          {"coherent", GPURT_COHERENCE_COHERENT},
                          {"incoherent", GPURT_COHERENCE_INCOHERENT}};

double percentile(std::vector<float> values, double share)
{
  std::sort(values.begin(), values.end());
  return values[size_t(share * double(values.size() - 1) + 0.5)];
}

// What a set of rays and a place for its results are.
struct RaySet {
  std::string name;
  std::vector<gpurt_ray> rays;
  void *d_rays = nullptr, *d_results = nullptr;
  bool is_any() const { return name == "ao"; }
  size_t result_bytes() const { return rays.size() * (is_any() ? 1 : sizeof(gpurt_hit_compact)); }
};

// The sets that are asked for, in device memory.
std::vector<RaySet> upload_sets(const Options &options, std::map<std::string, std::vector<gpurt_ray>> rays)
{
  std::vector<RaySet> sets;
  for (const char *name : {"primary", "ao", "diffuse", "random"}) {
    if (!options.only.empty() && options.only != name) continue;
    RaySet set{name, std::move(rays[name])};
    if (set.rays.empty()) continue;
    const size_t bytes = set.rays.size() * sizeof(gpurt_ray);
    check(cudaMalloc(&set.d_rays, bytes), "cudaMalloc");
    check(cudaMalloc(&set.d_results, set.result_bytes()), "cudaMalloc");
    check(cudaMemcpy(set.d_rays, set.rays.data(), bytes, cudaMemcpyHostToDevice), "cudaMemcpy");
    sets.push_back(std::move(set));
  }
  return sets;
}

std::vector<RaySet> read_sets(const Options &options)
{
  std::map<std::string, std::vector<gpurt_ray>> rays;
  for (const char *name : {"primary", "ao", "diffuse", "random"})
    rays[name] = read_file<gpurt_ray>(options.prefix + "." + name + ".rays");
  return upload_sets(options, std::move(rays));
}

void add_triangles(gpurt_scene scene, const std::vector<float> &corners)
{
  gpurt_mesh_desc mesh = GPURT_MESH_DESC_INIT;
  mesh.vertices.data = corners.data();
  mesh.vertices.count = corners.size() / 3;
  gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
  uint32_t id;
  check(gpurt_scene_add_mesh(scene, &mesh, &instance.geometry), "gpurt_scene_add_mesh");
  check(gpurt_scene_add_instance(scene, &instance, &id), "gpurt_scene_add_instance");
}

void bench_set(gpurt_scene scene, const std::string &device, const std::string &accel, double build_seconds,
               const RaySet &set, const Options &options, std::map<std::string, std::vector<char>> &expected)
{
  cudaStream_t stream;
  cudaEvent_t begin, end;
  check(cudaStreamCreate(&stream), "cudaStreamCreate");
  check(cudaEventCreate(&begin), "cudaEventCreate");
  check(cudaEventCreate(&end), "cudaEventCreate");
  for (const Hint &hint : hints) {
    for (uint32_t width : {0u, options.width}) {
      // An image's order says something of camera rays alone.
      if (width != 0 && (set.name != "primary" || hint.coherence == GPURT_COHERENCE_INCOHERENT)) continue;
      gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
      desc.query = set.is_any() ? GPURT_QUERY_ANY : GPURT_QUERY_CLOSEST;
      desc.format = GPURT_HIT_COMPACT;
      desc.storage = GPURT_STORAGE_DEVICE;
      desc.num_rays = set.rays.size();
      desc.rays = static_cast<const gpurt_ray *>(set.d_rays);
      if (set.is_any()) desc.occluded = static_cast<uint8_t *>(set.d_results);
      else desc.hits = set.d_results;
      desc.coherence = hint.coherence;
      desc.image_width = width;
      // The size of launches settles with synchronous calls.
      for (int i = 0; i < 6; ++i) check(gpurt_scene_trace(scene, &desc), "gpurt_scene_trace");
      std::vector<float> times;
      for (int i = 0; i < options.repeats + 3; ++i) {
        // The stream waits till all is queued: what is measured is the device's time alone.
        check(
            cudaLaunchHostFunc(
                stream, [](void *) { std::this_thread::sleep_for(std::chrono::microseconds(300)); }, nullptr),
            "cudaLaunchHostFunc");
        check(cudaEventRecord(begin, stream), "cudaEventRecord");
        check(gpurt_cuda_trace(scene, &desc, stream, nullptr, nullptr), "gpurt_cuda_trace");
        check(cudaEventRecord(end, stream), "cudaEventRecord");
        check(cudaEventSynchronize(end), "cudaEventSynchronize");
        float ms;
        check(cudaEventElapsedTime(&ms, begin, end), "cudaEventElapsedTime");
        if (i >= 3) times.push_back(ms);
      }
      std::vector<char> results(set.result_bytes());
      check(cudaMemcpy(results.data(), set.d_results, results.size(), cudaMemcpyDeviceToHost), "cudaMemcpy");
      std::vector<char> &first = expected[set.name];
      if (first.empty()) first = results;
      const size_t stride = set.result_bytes() / set.rays.size();
      size_t num_different = 0, num_hits = 0;
      for (size_t i = 0; i < set.rays.size(); ++i) {
        num_different += std::memcmp(&results[i * stride], &first[i * stride], stride) != 0;
        if (set.is_any()) num_hits += results[i] != 0;
        else
          num_hits +=
              reinterpret_cast<const gpurt_hit_compact *>(results.data())[i].primitive != GPURT_INVALID_ID;
      }
      const double m = percentile(times, 0.5), rays = double(set.rays.size());
      std::printf(
          "{\"bench\": \"cuda_rays\", \"device\": \"%s\", \"scene\": \"%s\", \"accel\": \"%s\", \"set\": "
          "\"%s\", "
          "\"build_ms\": %.2f, \"hint\": \"%s\", \"width\": %u, \"num_rays\": %zu, \"mrays_per_s\": %.0f, "
          "\"p10\": %.0f, "
          "\"p90\": %.0f, "
          "\"hit_share\": %.4f, \"num_different\": %zu}\n",
          device.c_str(), options.scene.c_str(), accel.c_str(), set.name.c_str(), build_seconds * 1e3,
          hint.name, width, set.rays.size(), rays / m * 1e-3, rays / percentile(times, 0.9) * 1e-3,
          rays / percentile(times, 0.1) * 1e-3, double(num_hits) / rays, num_different);
      std::fflush(stdout);
      if (options.width == 0) break;
    }
  }
  check(cudaEventDestroy(begin), "cudaEventDestroy");
  check(cudaEventDestroy(end), "cudaEventDestroy");
  check(cudaStreamDestroy(stream), "cudaStreamDestroy");
}

}  // namespace

int main(int argc, char **argv)
{
  Options options;
  std::vector<std::string> positional;
  for (int i = 1; i < argc; ++i) {
    const std::string name = argv[i];
    const bool has_value = i + 1 < argc;
    if (name == "--accel" && has_value) options.accels = argv[++i];
    else if (name == "--repeats" && has_value) options.repeats = std::max(1, std::atoi(argv[++i]));
    else if (name == "--width" && has_value) options.width = uint32_t(std::atoi(argv[++i]));
    else if (name == "--only" && has_value) options.only = argv[++i];
    else if (name == "--traversal-cost" && has_value) options.traversal_cost = float(std::atof(argv[++i]));
    else if (name == "--empty-bonus" && has_value) options.empty_bonus = float(std::atof(argv[++i]));
    else if (name == "--fast") options.quality = GPURT_BUILD_QUALITY_FAST;
    else positional.push_back(name);
  }
  if (argc == 1) {
    std::fprintf(stderr, "no rays given: nothing to measure\n");
    return 0;
  }
  const bool is_generated = positional.size() == 1 && bench::is_generated(positional[0]);
  if (positional.size() != 2 && !is_generated) {
    std::fprintf(stderr,
                 "usage: bench_rays SCENE.tris PREFIX | leaves | rocks | forest [--accel bvh,kdtree] "
                 "[--repeats N] [--width PIXELS] "
                 "[--only SET] [--traversal-cost X] [--empty-bonus X] [--fast]\n");
    return 2;
  }
  options.scene = positional[0];
  if (!is_generated) options.prefix = positional[1];
  std::vector<float> corners;
  if (!is_generated) corners = read_file<float>(options.scene);
  if (!is_generated && (corners.empty() || corners.size() % 9 != 0)) {
    std::fprintf(stderr, "error: %s holds no triangles of float32 [n][3][3]\n", options.scene.c_str());
    return 1;
  }
  if (!is_cuda_there()) return 0;
  const gpurt_device device = create_cuda_device(
      [](void *, gpurt_log_level, const char *message) { std::fprintf(stderr, "%s\n", message); });
  gpurt_device_properties properties = GPURT_DEVICE_PROPERTIES_INIT;
  check(gpurt_device_get_properties(device, &properties), "gpurt_device_get_properties");
  std::map<std::string, std::vector<char>> expected;
  std::vector<RaySet> sets;
  if (!is_generated) sets = read_sets(options);
  for (const auto &[name, accel] :
       {std::pair{"bvh", GPURT_ACCEL_BVH}, std::pair{"kdtree", GPURT_ACCEL_KDTREE},
        std::pair{"auto", GPURT_ACCEL_AUTO}}) {
    if (options.accels.find(name) == std::string::npos) continue;
    gpurt_scene scene;
    check(gpurt_scene_create(device, &scene), "gpurt_scene_create");
    if (is_generated) bench::fill_generated(options.scene, scene);
    else add_triangles(scene, corners);
    gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
    build.accel = accel;
    build.quality = options.quality;
    if (accel == GPURT_ACCEL_KDTREE) {
      build.traversal_cost = options.traversal_cost;
      build.empty_bonus = options.empty_bonus;
    }
    const auto start = std::chrono::steady_clock::now();
    check(gpurt_scene_commit(scene, &build), "gpurt_scene_commit");
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    gpurt_scene_facts facts = GPURT_SCENE_FACTS_INIT;
    check(gpurt_scene_get_facts(scene, &facts), "gpurt_scene_get_facts");
    std::printf(
        "{\"bench\": \"cuda_commit\", \"device\": \"%s\", \"scene\": \"%s\", \"accel\": \"%s\", "
        "\"triangles\": %zu, "
        "\"commit_s\": %.3f, \"accel_build_s\": %.4f, \"build_peak_bytes\": %llu, \"accel_bytes\": %llu, "
        "\"references\": "
        "%llu, \"nodes\": %llu}\n",
        properties.name, options.scene.c_str(), name, size_t(facts.num_triangles), seconds,
        facts.accel_build_seconds, (unsigned long long)facts.build_peak_bytes,
        (unsigned long long)facts.accel_bytes, (unsigned long long)facts.num_references,
        (unsigned long long)facts.num_nodes);
    if (is_generated && sets.empty()) {
      sets = upload_sets(options, bench::make_generated_rays(options.scene, scene));
      options.width = bench::generated_width;
    }
    for (const RaySet &set : sets)
      bench_set(scene, properties.name, name, facts.accel_build_seconds, set, options, expected);
    check(gpurt_scene_release(scene), "gpurt_scene_release");
  }
  for (const RaySet &set : sets) {
    check(cudaFree(set.d_rays), "cudaFree");
    check(cudaFree(set.d_results), "cudaFree");
  }
  check(gpurt_device_release(device), "gpurt_device_release");
  return 0;
}
