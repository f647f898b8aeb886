// Rows 8, 20, 21, 48: input that must be refused, or borne.
#include <sys/mman.h>

#include "catalogue.h"

namespace {

using namespace gpurt_test;

class Input : public Stability {
 protected:
  void check(bool holds, const char *what)
  {
    ++trials_;
    if (holds) return;
    ++failures_;
    std::printf("  not so: %s (%s)\n", what, gpurt_last_error());
  }

  bool last_error_names(const char *text) const
  {
    return std::string(gpurt_last_error()).find(text) != std::string::npos;
  }

  uint64_t failures_ = 0, trials_ = 0;
};
GPURT_STABILITY_SUITE(Input);

TEST_P(Input, Row08NotFinite)
{
  const float nan = std::numeric_limits<float>::quiet_NaN();
  Mesh many;
  std::mt19937_64 rng(8);
  const uint32_t n = 1000000;
  for (uint32_t i = 0; i < n; ++i) {
    many.vertices.push_back({float(uniform(rng)), float(uniform(rng)), float(uniform(rng))});
  }
  for (uint32_t i = 0; i + 2 < n; i += 3) many.triangles.push_back({i, i + 1, i + 2});
  for (const float bad : {nan, infinite, -infinite}) {
    Mesh poisoned = many;
    poisoned.vertices[765432][int(pick(rng, 3))] = bad;
    const Scene scene = make_scene();
    gpurt_mesh_desc desc = GPURT_MESH_DESC_INIT;
    desc.vertices.data = poisoned.vertices.data();
    desc.vertices.count = poisoned.vertices.size();
    desc.indices.data = poisoned.triangles.data();
    desc.indices.count = poisoned.triangles.size();
    uint32_t geometry;
    check(gpurt_scene_add_mesh(scene, &desc, &geometry) == GPURT_ERROR_INVALID_ARGUMENT,
          "a vertex that is not finite is refused");
    check(last_error_names("765432"), "the error names the vertex");
  }

  // Rays with every kind of number in every place: none hits, none hangs, and their neighbours are not disturbed.
  const Scene scene = make_scene(icosphere(3));
  std::vector<gpurt_ray> rays;
  std::vector<bool> must_hit;
  for (int field = 0; field < 8; ++field) {
    for (const float bad : {nan, -nan, infinite, -infinite}) {
      gpurt_ray ray = make_ray({0.1f, 0.2f, 0.3f}, {0.3f, -0.5f, 0.8f});
      rays.push_back(ray);
      must_hit.push_back(true);
      float *fields[8] = {&ray.origin[0],    &ray.origin[1],    &ray.origin[2],    &ray.tmin,
                          &ray.direction[0], &ray.direction[1], &ray.direction[2], &ray.tmax};
      *fields[field] = bad;
      rays.push_back(ray);
      // An infinite interval is sound, an empty one is not.
      must_hit.push_back((field == 3 && bad == -infinite) || (field == 7 && bad == infinite));
    }
  }
  gpurt_ray zero = make_ray({0, 0, 0}, {0, 0, 0}), empty = make_ray({0, 0, 0}, {1, 0, 0}, 3, 2);
  rays.insert(rays.end(), {zero, empty});
  must_hit.insert(must_hit.end(), {false, false});
  const std::vector<gpurt_hit> hits = trace_closest(scene, rays);
  for (size_t i = 0; i < rays.size(); ++i) {
    check(must_hit[i] == !is_miss(hits[i]),
          ("ray " + std::to_string(i) + (must_hit[i] ? " hits" : " misses")).c_str());
    if (!must_hit[i])
      check(std::memcmp(&hits[i].t, &rays[i].tmax, sizeof(float)) == 0, "the t of a miss is the ray's tmax");
  }
  record(8, method(), failures_, trials_);
}

TEST_P(Input, Row20FewTriangles)
{
  const gpurt_ray down = make_ray({0.25f, 0.25f, 1}, {0, 0, -1});
  const Mesh one = {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}};
  Mesh two = one;
  two.append(moved(one, 1, {0, 0, -1}, false));
  // Points, segments, a vertex named twice, and corners in a line that no float arithmetic sees as one.
  const Mesh degenerate = {{{0, 0, 0},
                            {1, 0, 0},
                            {0.5f, 0, 0},
                            {0.25f, 0.25f, 0},
                            {0.25f, 0.25f, 0},
                            {0.1f, 0.1f, 0.1f},
                            {0.2f, 0.2f, 0.2f},
                            {0.3f, 0.3f, 0.3f}},
                           {{0, 0, 0}, {0, 1, 2}, {0, 1, 1}, {3, 4, 0}, {3, 4, 4}, {5, 6, 6}, {5, 7, 5}}};
  struct Case {
    const char *what;
    Mesh mesh;
    uint32_t primitive;
  };
  Mesh mixed = degenerate;
  mixed.append(one);
  const std::vector<Case> cases = {
      {"one triangle", one, 0},
      {"two triangles", two, 0},
      {"degenerate triangles alone", degenerate, GPURT_INVALID_ID},
      {"degenerate triangles and one", mixed, uint32_t(degenerate.triangles.size())}};
  for (const Case &c : cases) {
    const Scene scene = make_scene(c.mesh);
    const gpurt_hit hit = trace_closest(scene, {down})[0];
    check(hit.primitive == c.primitive, c.what);
    // The kd-tree's t is exact here; Embree divides by an approximate reciprocal: a few ulp.
    const float t_error = method().is_embree() ? 4 * 0x1p-23f : 0.0f;
    if (hit.primitive == c.primitive && !is_miss(hit)) check(std::abs(hit.t - 1) <= t_error, c.what);
    // Rays through the degenerate ones, along them too.
    std::vector<gpurt_ray> rays;
    for (const Point &v : degenerate.vertices) {
      rays.push_back(ray_towards({v[0], v[1], v[2] + 1}, v));
      rays.push_back(ray_towards({-1, 0, 0}, v));
      rays.push_back(ray_towards({-1, -1, -1}, v));
    }
    if (c.mesh.triangles.size() == degenerate.triangles.size()) {
      check(count_hits(scene, rays, [](size_t, const gpurt_hit &h) { return !is_miss(h); }) == 0,
            "degenerate triangles are never hit");
    }
  }
  {
    const Scene scene = make_scene();
    commit_scene(scene);
    check(is_miss(trace_closest(scene, {down})[0]), "an empty scene is missed");
    std::vector<uint64_t> offsets;
    check(trace_all(scene, {down}, offsets).empty(), "an empty scene has no crossings");
    check(trace_closest(scene, {}).empty(), "no rays");
  }
  {
    // Instances of an empty mesh and of degenerate ones beside a real one.
    const Scene scene = make_scene();
    add_mesh(scene, Mesh{});
    add_mesh(scene, degenerate);
    add_mesh(scene, one);
    commit_scene(scene);
    const gpurt_hit hit = trace_closest(scene, {down})[0];
    check(hit.geometry == 2 && hit.instance == 2 && hit.primitive == 0, "a mesh beside empty ones");
  }
  record(20, method(), failures_, trials_);
}

TEST_P(Input, Row21BadIndicesAndCounts)
{
  const Scene scene = make_scene();
  std::vector<Point> vertices(100, Point{0, 0, 0});
  std::vector<std::array<uint32_t, 3>> triangles(5000, {0, 1, 2});
  gpurt_mesh_desc desc = GPURT_MESH_DESC_INIT;
  desc.vertices.data = vertices.data();
  desc.vertices.count = vertices.size();
  desc.indices.data = triangles.data();
  desc.indices.count = triangles.size();
  uint32_t geometry;
  const auto refused = [&](const gpurt_mesh_desc &d) {
    return gpurt_scene_add_mesh(scene, &d, &geometry) == GPURT_ERROR_INVALID_ARGUMENT;
  };
  for (const uint32_t bad : {100u, 0x7fffffffu, 0xffffffffu}) {
    triangles[4321][1] = bad;
    check(refused(desc), "an index past the vertices is refused");
    check(last_error_names("4321") || last_error_names("12964"), "the error names where it is");
  }
  triangles[4321][1] = 1;

  // A shared buffer of 1200 bytes, and arrays that claim to lie in it.
  gpurt_buffer_desc buffer_desc = GPURT_BUFFER_DESC_INIT;
  buffer_desc.size_bytes = vertices.size() * sizeof(Point);
  buffer_desc.data = vertices.data();
  Owned<gpurt_buffer, gpurt_buffer_release> buffer;
  GPURT_ASSERT_OK(gpurt_buffer_create(device_, &buffer_desc, buffer.out()));
  desc.vertices.data = nullptr;
  desc.vertices.buffer = buffer;
  struct Claim {
    uint64_t offset, stride, count;
  };
  for (const Claim &c :
       {Claim{0, 0, 101}, Claim{12, 0, 100}, Claim{0, 13, 100}, Claim{1200, 0, 1},
        Claim{0, 0, uint64_t(1) << 29}, Claim{0, 0, uint64_t(1) << 62}, Claim{~uint64_t(0) - 11, 0, 1},
        Claim{0, uint64_t(1) << 63, 3}, Claim{0, ~uint64_t(0), 2}}) {
    gpurt_mesh_desc d = desc;
    d.vertices.offset_bytes = c.offset;
    d.vertices.stride_bytes = c.stride;
    d.vertices.count = c.count;
    check(refused(d), ("offset " + std::to_string(c.offset) + ", stride " + std::to_string(c.stride) +
                       ", count " + std::to_string(c.count) + " is refused")
                          .c_str());
  }
  desc.vertices.buffer = nullptr;
  desc.vertices.data = vertices.data();
  // Sizes that overflow 64 bits.
  desc.indices.count = uint64_t(1) << 62;
  check(gpurt_scene_add_mesh(scene, &desc, &geometry) != GPURT_OK, "2^62 triangles are refused");
  desc.indices.count = triangles.size();

  // More than 2^31 bytes that are really there (pages of zeros, which take no memory until they are written): the index
  // in the last triangle is found, or the limit of the device is.
  const uint64_t bytes = uint64_t(0xc0000000);
  void *zeros = mmap(nullptr, bytes, PROT_READ, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  ASSERT_NE(zeros, MAP_FAILED);
  const Device limited = make_device(method().device, 0, 64 << 20);
  Scene large;
  GPURT_ASSERT_OK(gpurt_scene_create(limited, large.out()));
  gpurt_mesh_desc huge = desc;
  huge.indices.data = zeros;
  huge.indices.count = bytes / 12;
  check(gpurt_scene_add_mesh(large, &huge, &geometry) == GPURT_ERROR_OUT_OF_MEMORY,
        "3 GB of indices exceed a limit of 64 MB");
  munmap(zeros, bytes);

  // After all that the scene is as it was.
  check(gpurt_scene_add_mesh(scene, &desc, &geometry) == GPURT_OK && geometry == 0,
        "refused meshes leave no trace");
  gpurt_trace_desc trace = GPURT_TRACE_DESC_INIT;
  gpurt_ray ray = make_ray({0, 0, 0}, {0, 0, 1});
  gpurt_hit hit;
  trace.rays = &ray;
  trace.hits = &hit;
  trace.num_rays = 1;
  check(gpurt_scene_trace(scene, &trace) == GPURT_ERROR_INVALID_ARGUMENT,
        "a scene without a commit cannot be traced");
  commit_scene(scene);
  trace.num_rays = uint64_t(1) << 60;
  trace.rays = nullptr;
  check(gpurt_scene_trace(scene, &trace) == GPURT_ERROR_INVALID_ARGUMENT, "2^60 rays at NULL are refused");
  record(21, method(), failures_, trials_);
}

TEST_P(Input, Row48OutOfMemory)
{
  const uint64_t limit = is_full_run() ? 256 << 20 : 48 << 20;
  const int levels = is_full_run() ? 9 : 8;
  device_ = make_device(method().device, 0, limit);
  const gpurt_ray ray = make_ray({0, 0, 0}, {0.6f, 0.8f, 0});
  const Scene scene = make_scene(icosphere(3));
  const gpurt_hit before = trace_closest(scene, {ray})[0];
  check(!is_miss(before), "a small scene fits");
  gpurt_device_properties properties = GPURT_DEVICE_PROPERTIES_INIT;
  GPURT_ASSERT_OK(gpurt_device_get_properties(device_, &properties));
  const uint64_t used_before = properties.memory_used_bytes;

  // Whatever step finds that there is no room, adding or committing: an error, and what was there stays.
  const Mesh big = moved(icosphere(levels), 0.5);
  gpurt_result result = GPURT_OK;
  int copies = 0;
  for (; copies < 64 && result == GPURT_OK; ++copies) {
    gpurt_mesh_desc desc = GPURT_MESH_DESC_INIT;
    desc.vertices.data = big.vertices.data();
    desc.vertices.count = big.vertices.size();
    desc.indices.data = big.triangles.data();
    desc.indices.count = big.triangles.size();
    gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
    result = gpurt_scene_add_mesh(scene, &desc, &instance.geometry);
    uint32_t id;
    if (result == GPURT_OK) result = gpurt_scene_add_instance(scene, &instance, &id);
    gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
    build.accel = method().accel;
    build.triangle_test = method().test;
    if (result == GPURT_OK) result = gpurt_scene_commit(scene, &build);
  }
  check(result == GPURT_ERROR_OUT_OF_MEMORY, "a scene beyond the limit is refused");
  if (copies == 1) {
    const gpurt_hit after = trace_closest(scene, {ray})[0];
    check(std::memcmp(&before, &after, sizeof before) == 0, "the last commit is still in force");
  }
  GPURT_ASSERT_OK(gpurt_device_get_properties(device_, &properties));
  check(properties.memory_peak_bytes <= limit, "the limit was kept at all times");
  check(properties.memory_used_bytes >= used_before, "what is held is still counted");
  {
    const Scene next = make_scene(icosphere(2));
    check(!is_miss(trace_closest(next, {ray})[0]), "the next call works");
  }
  record(48, method(), failures_, trials_, std::to_string(copies - 1) + " large meshes fitted");
}

}  // namespace
