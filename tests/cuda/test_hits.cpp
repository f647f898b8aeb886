// Hits have the same bits on every device: the CPU and a CUDA device are asked the same, through the kd-tree and the bvh.
//
// The bodies take two devices. Without a GPU they compare one CPU thread with all of them, on fewer rays.
#include <chrono>
#include <cstdio>
#include <limits>
#include <thread>

#include "gpurt_cuda.h"
#include "kernel_launches.h"
#include "scenes.h"

namespace gpurt_test {
namespace {

struct DevicePair {
  Device reference, tested;
};

DevicePair cpu_and_cuda() { return {make_device(GPURT_DEVICE_CPU), make_device(GPURT_DEVICE_CUDA)}; }
DevicePair one_and_many_threads()
{
  return {make_device(GPURT_DEVICE_CPU, 1), make_device(GPURT_DEVICE_CPU, 0)};
}

// The same scene on two devices, with targets for rays.
struct ScenePair {
  Scene reference, tested;
  RayTargets targets;
};

ScenePair make_scenes(const DevicePair &devices, const TestScene &content, gpurt_triangle_test test,
                      gpurt_accel accel = GPURT_ACCEL_KDTREE)
{
  ScenePair pair;
  GPURT_EXPECT_OK(gpurt_scene_create(devices.reference, pair.reference.out()));
  GPURT_EXPECT_OK(gpurt_scene_create(devices.tested, pair.tested.out()));
  pair.targets = content.fill(pair.reference);
  content.fill(pair.tested);
  commit(pair.reference, GPURT_ACCEL_KDTREE, test);
  pair.targets.planes = split_planes(pair.reference);
  if (accel != GPURT_ACCEL_KDTREE) commit(pair.reference, accel, test);
  commit(pair.tested, accel, test);
  return pair;
}

std::string describe(const gpurt_ray &r)
{
  char text[256];
  std::snprintf(text, sizeof text, "origin %a %a %a, direction %a %a %a, t %a .. %a", r.origin[0],
                r.origin[1], r.origin[2], r.direction[0], r.direction[1], r.direction[2], r.tmin, r.tmax);
  return text;
}
std::string describe(const gpurt_hit &h)
{
  char text[256];
  std::snprintf(text, sizeof text, "t %a u %a v %a primitive %u geometry %u instance %u", h.t, h.u, h.v,
                h.primitive, h.geometry, h.instance);
  return text;
}

template <class T>
bool same_bits(const T &a, const T &b)
{
  return std::memcmp(&a, &b, sizeof(T)) == 0;
}

template <class T>
std::vector<T> trace(gpurt_scene scene, gpurt_query query, gpurt_hit_format format,
                     const std::vector<gpurt_ray> &rays)
{
  std::vector<T> results(rays.size());
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.query = query;
  desc.format = format;
  desc.num_rays = rays.size();
  desc.rays = rays.data();
  if (query == GPURT_QUERY_ANY) desc.occluded = reinterpret_cast<uint8_t *>(results.data());
  else desc.hits = results.data();
  GPURT_EXPECT_OK(gpurt_scene_trace(scene, &desc));
  return results;
}

// Rays first .. first + count - 1 of a scene's sequence, made by all threads.
std::vector<gpurt_ray> make_rays(const RayTargets &targets, uint64_t first, uint64_t count)
{
  std::vector<gpurt_ray> rays(count);
  const uint64_t num_threads = std::max(1u, std::thread::hardware_concurrency());
  std::vector<std::thread> threads;
  for (uint64_t t = 0; t < num_threads; ++t) {
    threads.emplace_back([&, begin = count * t / num_threads, end = count * (t + 1) / num_threads] {
      for (uint64_t i = begin; i < end; ++i) rays[i] = make_ray(targets, first + i);
    });
  }
  for (std::thread &thread : threads) thread.join();
  return rays;
}

// Adds up the seconds of what it is told to run.
class Stopwatch {
 public:
  template <class F>
  auto operator()(F &&f)
  {
    const auto start = std::chrono::steady_clock::now();
    auto result = f();
    seconds_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return result;
  }
  double seconds() const { return seconds_; }

 private:
  double seconds_ = 0;
};

// Closest hits in both formats and any hits, in batches so that memory stays small. Returns how many rays hit.
uint64_t compare_queries(const ScenePair &scenes, uint64_t num_rays)
{
  constexpr uint64_t batch = uint64_t(1) << 20;
  uint64_t num_different = 0, num_hits = 0;
  Stopwatch making, reference, tested;
  for (uint64_t first = 0; first < num_rays && num_different == 0; first += batch) {
    const std::vector<gpurt_ray> rays =
        making([&] { return make_rays(scenes.targets, first, std::min(batch, num_rays - first)); });
    const auto expected = reference(
        [&] { return trace<gpurt_hit>(scenes.reference, GPURT_QUERY_CLOSEST, GPURT_HIT_FULL, rays); });
    const auto full =
        tested([&] { return trace<gpurt_hit>(scenes.tested, GPURT_QUERY_CLOSEST, GPURT_HIT_FULL, rays); });
    const auto compact =
        trace<gpurt_hit_compact>(scenes.tested, GPURT_QUERY_CLOSEST, GPURT_HIT_COMPACT, rays);
    const auto any = trace<uint8_t>(scenes.tested, GPURT_QUERY_ANY, GPURT_HIT_FULL, rays);
    for (size_t i = 0; i < rays.size(); ++i) {
      const bool is_hit = expected[i].primitive != GPURT_INVALID_ID;
      const gpurt_hit_compact expected_compact{expected[i].t, expected[i].u, expected[i].v,
                                               expected[i].primitive};
      num_hits += is_hit;
      if (same_bits(full[i], expected[i]) && same_bits(compact[i], expected_compact) &&
          any[i] == uint8_t(is_hit))
        continue;
      if (++num_different > 8) continue;
      ADD_FAILURE() << "ray " << first + i << " (" << ray_kind_name(first + i) << "): " << describe(rays[i])
                    << "\n  expected " << describe(expected[i]) << "\n  full     " << describe(full[i])
                    << "\n  compact t " << compact[i].t << " primitive " << compact[i].primitive << ", any "
                    << int(any[i]);
    }
  }
  EXPECT_EQ(num_different, 0u);
  std::printf(
      "%llu rays, %llu hit; seconds: making them %.2f, closest hits of the reference %.2f, of the tested "
      "device %.2f\n",
      static_cast<unsigned long long>(num_rays), static_cast<unsigned long long>(num_hits), making.seconds(),
      reference.seconds(), tested.seconds());
  return num_hits;
}

struct AllHits {
  std::vector<uint64_t> offsets;
  std::vector<gpurt_hit> hits;
};

AllHits trace_all(gpurt_scene scene, const std::vector<gpurt_ray> &rays)
{
  AllHits all;
  all.offsets.resize(rays.size() + 1);
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.query = GPURT_QUERY_ALL;
  desc.num_rays = rays.size();
  desc.rays = rays.data();
  desc.offsets = all.offsets.data();
  GPURT_EXPECT_OK(gpurt_scene_trace(scene, &desc));
  const std::vector<uint64_t> counted = all.offsets;
  all.hits.resize(all.offsets.back());
  desc.hits = all.hits.data();
  desc.hit_capacity = all.hits.size();
  GPURT_EXPECT_OK(gpurt_scene_trace(scene, &desc));
  EXPECT_EQ(counted, all.offsets);
  return all;
}

void expect_same_hits(const AllHits &expected, const AllHits &tested, const std::vector<gpurt_ray> &rays)
{
  ASSERT_EQ(tested.offsets, expected.offsets);
  EXPECT_GT(expected.hits.size(), 0u);
  uint64_t num_different = 0;
  for (size_t i = 0; i < rays.size(); ++i) {
    for (uint64_t k = expected.offsets[i]; k < expected.offsets[i + 1]; ++k) {
      if (same_bits(tested.hits[k], expected.hits[k]) || ++num_different > 4) continue;
      ADD_FAILURE() << "ray " << i << " (" << ray_kind_name(i) << "), hit " << k - expected.offsets[i] << ": "
                    << describe(rays[i]) << "\n  expected " << describe(expected.hits[k]) << "\n  but      "
                    << describe(tested.hits[k]);
    }
  }
  EXPECT_EQ(num_different, 0u);
}

void compare_all_hits(const ScenePair &scenes, uint64_t num_rays)
{
  const std::vector<gpurt_ray> rays = make_rays(scenes.targets, 0, num_rays);
  expect_same_hits(trace_all(scenes.reference, rays), trace_all(scenes.tested, rays), rays);
}

void compare_scene(const DevicePair &devices, const TestScene &content, gpurt_accel accel, uint64_t num_rays,
                   uint64_t num_other_tests, uint64_t num_all)
{
  SCOPED_TRACE(content.name);
  const ScenePair scenes = make_scenes(devices, content, GPURT_TRIANGLE_WATERTIGHT, accel);
  const uint64_t num_hits = compare_queries(scenes, num_rays);
  // The rays must try something: of eye, random and aimed ones alone a fifth meets the scene.
  EXPECT_GT(num_hits, num_rays / 5);
  compare_all_hits(scenes, num_all);
  for (gpurt_triangle_test test : {GPURT_TRIANGLE_MOLLER_TRUMBORE, GPURT_TRIANGLE_DOUBLE}) {
    SCOPED_TRACE(test == GPURT_TRIANGLE_DOUBLE ? "double" : "Moeller-Trumbore");
    compare_queries(make_scenes(devices, content, test, accel), num_other_tests);
  }
}

// A scene and an accelerator.
using Params = std::tuple<size_t, gpurt_accel>;
std::string name_of(const testing::TestParamInfo<Params> &info)
{
  return test_scenes()[std::get<0>(info.param)].name +
         std::string(std::get<1>(info.param) == GPURT_ACCEL_BVH ? "_bvh" : "");
}
const auto all_params = testing::Combine(testing::Range(size_t(0), test_scenes().size()),
                                         testing::Values(GPURT_ACCEL_KDTREE, GPURT_ACCEL_BVH));

class CudaHits : public testing::TestWithParam<Params> {};

TEST_P(CudaHits, HaveTheBitsOfTheCpu)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const auto [scene, accel] = GetParam();
  compare_scene(cpu_and_cuda(), test_scenes()[scene], accel, amount(10'000'000, 4'000),
                amount(1'000'000, 1'500), amount(100'000, 500));
}

INSTANTIATE_TEST_SUITE_P(Scenes, CudaHits, all_params, name_of);

class Hits : public testing::TestWithParam<Params> {};

TEST_P(Hits, DoNotDependOnTheNumberOfThreads)
{
  const auto [scene, accel] = GetParam();
  compare_scene(one_and_many_threads(), test_scenes()[scene], accel, 100'000, 20'000, 2'000);
}

INSTANTIATE_TEST_SUITE_P(Scenes, Hits, all_params, name_of);

// More hits a ray than are sorted by insertion, more in all than are listed at a time, and a ray that alone has more than
// most have together.
void compare_stacks(const DevicePair &devices, uint32_t num_layers, size_t num_rays,
                    gpurt_accel accel = GPURT_ACCEL_KDTREE)
{
  ScenePair pair;
  Mesh stack;
  for (uint32_t i = 0; i < num_layers; ++i) {
    const float z = float(i % 2 ? i : num_layers - i), x = float(i % 5);
    stack.append(quad({x - 6, -1, z}, {x + 1, -1, z}, {x + 1, 1, z}, {x - 6, 1, z}));
  }
  for (Scene *scene : {&pair.reference, &pair.tested}) {
    GPURT_ASSERT_OK(
        gpurt_scene_create(scene == &pair.reference ? devices.reference : devices.tested, scene->out()));
    add_mesh(*scene, stack);
    commit(*scene, accel);
  }
  pair.targets.mesh = stack;
  std::vector<gpurt_ray> rays;
  Random random(31);
  for (size_t i = 0; i < num_rays; ++i) {
    const float x = random.between(-6, 6), y = random.between(-1, 1);
    rays.push_back({{x, y, -1},
                    0,
                    {random.between(-1e-3f, 1e-3f), 0, 1},
                    i % 3 ? 1e30f : float(random.below(num_layers))});
  }
  expect_same_hits(trace_all(pair.reference, rays), trace_all(pair.tested, rays), rays);
}

TEST(CudaStacks, HaveTheBitsOfTheCpu)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  compare_stacks(cpu_and_cuda(), uint32_t(amount(500, 100)), amount(10'000, 300));
  compare_stacks(cpu_and_cuda(), uint32_t(amount(500, 100)), amount(10'000, 300), GPURT_ACCEL_BVH);
  compare_stacks(cpu_and_cuda(), uint32_t(amount(100'000, 1'000)), 3);
}

TEST(Stacks, DoNotDependOnTheNumberOfThreads) { compare_stacks(one_and_many_threads(), 300, 200); }

// A tree from its root, each node before its children: where a device keeps nodes and lists is its own affair.
std::vector<uint32_t> walk(const std::vector<gpurt_kdtree_node> &nodes,
                           const std::vector<uint32_t> &references)
{
  std::vector<uint32_t> seen, todo = {0};
  while (!todo.empty()) {
    const gpurt_kdtree_node node = nodes.at(todo.back());
    todo.pop_back();
    seen.push_back(node.tag & 3u);
    const uint32_t payload = node.tag >> 2;
    if ((node.tag & 3u) == 3u) {
      seen.push_back(payload);
      for (uint32_t i = 0; i < payload; ++i) seen.push_back(references.at(node.word + i));
    } else {
      seen.push_back(node.word);  // the plane
      todo.push_back(payload + 1);
      todo.push_back(payload);
    }
  }
  return seen;
}

// Trees that were exported are traversed as they are, on either device.
TEST(CudaTrees, AreExchangedBetweenDevices)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const DevicePair devices = cpu_and_cuda();
  const ScenePair scenes = make_scenes(devices, test_scenes()[0], GPURT_TRIANGLE_WATERTIGHT);
  // Of the same settings, trees are the same.
  gpurt_build_desc desc = GPURT_BUILD_DESC_INIT;
  desc.accel = GPURT_ACCEL_KDTREE;
  desc.traversal_cost = 2;
  GPURT_ASSERT_OK(gpurt_scene_commit(scenes.tested, &desc));
  gpurt_kdtree trees[2] = {GPURT_KDTREE_INIT, GPURT_KDTREE_INIT};
  std::vector<gpurt_kdtree_node> nodes[2];
  std::vector<uint32_t> references[2];
  for (int i = 0; i < 2; ++i) {
    const gpurt_scene scene = i == 0 ? gpurt_scene(scenes.reference) : gpurt_scene(scenes.tested);
    GPURT_ASSERT_OK(gpurt_scene_export_tree(scene, &trees[i]));
    nodes[i].resize(trees[i].num_nodes);
    references[i].resize(trees[i].num_references);
    trees[i].nodes = nodes[i].data();
    trees[i].references = references[i].data();
    GPURT_ASSERT_OK(gpurt_scene_export_tree(scene, &trees[i]));
  }
  ASSERT_EQ(nodes[0].size(), nodes[1].size());
  EXPECT_TRUE(walk(nodes[0], references[0]) == walk(nodes[1], references[1]));
  GPURT_ASSERT_OK(gpurt_scene_import_tree(scenes.tested, &trees[0]));
  commit(scenes.tested, GPURT_ACCEL_AUTO);
  gpurt_scene_facts facts = GPURT_SCENE_FACTS_INIT;
  GPURT_ASSERT_OK(gpurt_scene_get_facts(scenes.tested, &facts));
  EXPECT_EQ(facts.accel, GPURT_ACCEL_KDTREE);
  EXPECT_EQ(facts.tree_from_cache, 1u);
  compare_queries(scenes, amount(100'000, 3'000));
}

void commit_fast(gpurt_scene scene, gpurt_accel accel = GPURT_ACCEL_BVH)
{
  gpurt_build_desc desc = GPURT_BUILD_DESC_INIT;
  desc.accel = accel;
  desc.quality = GPURT_BUILD_QUALITY_FAST;
  GPURT_EXPECT_OK(gpurt_scene_commit(scene, &desc));
}

gpurt_scene_facts facts_of(gpurt_scene scene)
{
  gpurt_scene_facts facts = GPURT_SCENE_FACTS_INIT;
  GPURT_EXPECT_OK(gpurt_scene_get_facts(scene, &facts));
  return facts;
}

TEST(CudaFastBvhs, HitWhatTheCpusHit)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const DevicePair devices = cpu_and_cuda();
  for (const TestScene &content : scenes_of_each_kind()) {
    SCOPED_TRACE(content.name);
    const ScenePair scenes = make_scenes(devices, content, GPURT_TRIANGLE_WATERTIGHT, GPURT_ACCEL_BVH);
    const gpurt_scene_facts host = facts_of(scenes.tested);
    EXPECT_EQ(host.build_peak_bytes, 0u);
    commit_fast(scenes.tested);
    const gpurt_scene_facts facts = facts_of(scenes.tested);
    const bool has_large_trees = content.name != "city";
    EXPECT_EQ(facts.build_peak_bytes != 0, has_large_trees);
    EXPECT_EQ(facts.tree_refitted, 0u);
    EXPECT_GT(facts.accel_build_seconds, 0.0);
    EXPECT_LT(facts.accel_build_seconds, facts.build_seconds);
    EXPECT_LT(facts.sah_cost, host.sah_cost * 1.05);
    EXPECT_GE(facts.num_references, facts.num_triangles * 9 / 10);
    EXPECT_LE(facts.tree_depth, 64u);
    EXPECT_GT(compare_queries(scenes, amount(1'000'000, 3'000)), amount(40'000, 120));
    compare_all_hits(scenes, amount(50'000, 500));
  }
}

TEST(CudaFastKdTrees, HitWhatTheCpusHit)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const DevicePair devices = cpu_and_cuda();
  for (const TestScene &content : scenes_of_each_kind()) {
    SCOPED_TRACE(content.name);
    const ScenePair scenes = make_scenes(devices, content, GPURT_TRIANGLE_WATERTIGHT, GPURT_ACCEL_KDTREE);
    const gpurt_scene_facts host = facts_of(scenes.tested);
    EXPECT_EQ(host.build_peak_bytes, 0u);
    commit_fast(scenes.tested, GPURT_ACCEL_KDTREE);
    const gpurt_scene_facts facts = facts_of(scenes.tested);
    EXPECT_EQ(facts.build_peak_bytes != 0, content.name != "city");
    EXPECT_LT(facts.sah_cost, host.sah_cost * 1.05);
    EXPECT_GE(facts.num_references, facts.num_triangles * 9 / 10);
    EXPECT_LE(facts.tree_depth, 48u);
    EXPECT_GT(compare_queries(scenes, amount(1'000'000, 3'000)), amount(40'000, 120));
    compare_all_hits(scenes, amount(50'000, 500));
  }
}

// Trees of leaves, all of them placed, and nothing else: near and far, turned, from very small to large, over one another, and
// each of the first three twice in the same place, so that ids decide. Leaves' triangles are in part masked, in part not.
RayTargets fill_grove(gpurt_scene scene)
{
  RayTargets leaves =
      fill_leaves(scene, Leaves::Mask, false);  // also adds a sphere; its material lets nothing pass
  const uint32_t masked = 0, solid = 1;
  RayTargets targets;
  Random random(41);
  for (int i = 0; i < 300; ++i) {
    const float size = std::exp2(random.between(-9, 1)), angle = random.between(0, 6.28f),
                c = size * std::cos(angle), s = size * std::sin(angle);
    const Vec at = random.inside({-60, -5, -60}, {60, 5, 60});
    const std::array<float, 12> t = {c, 0, s, at[0], 0, i % 5 ? size : -size, 0, at[1], -s, 0, c, at[2]};
    for (int k = 0; k < (i < 3 ? 2 : 1); ++k) place(scene, i % 4 == 3 ? solid : masked, t);
    Mesh world = i % 4 == 3 ? icosphere(3) : leaves.mesh;
    if (i % 10 != 0) continue;  // rays are aimed at a part
    targets.mesh.append(world.map([&](Vec v) {
      return Vec{t[0] * v[0] + t[2] * v[2] + t[3], t[5] * v[1] + t[7], t[8] * v[0] + t[10] * v[2] + t[11]};
    }));
  }
  set_bounds(targets);
  return targets;
}

// As many as are traced by one launch after a commit, whose later launches are the shorter the slower the device has been: enough
// for kernels of either order. In the short form most pass the scene by, which takes little time.
std::vector<gpurt_ray> rays_of_a_launch(const RayTargets &targets)
{
  const size_t every = amount(1, 32), num_rays = size_t(1) << 18;
  const std::vector<gpurt_ray> aimed = make_rays(targets, 0, num_rays / every);
  std::vector<gpurt_ray> rays(num_rays);
  for (size_t i = 0; i < num_rays; ++i) {
    const size_t warp = i / 32;
    if (warp % every == 0) {
      rays[i] = aimed[warp / every * 32 + i % 32];
      continue;
    }
    rays[i] = {{targets.hi[0] + 1, targets.hi[1] + 1, targets.hi[2] + 1}, 0, {0.1f, 0.1f, 0.1f}, 1e30f};
    rays[i].direction[i % 3] = 1;
  }
  return rays;
}

// Kernels for rays that go together and for rays that do not: enough rays for either to be taken. They are the fast ones, which
// alone have a kernel that finishes what they leave over, or go by rounds, whatever the order and number of rays.
void compare_orders(const DevicePair &devices, const TestScene &content, gpurt_accel accel,
                    bool is_by_rounds = false)
{
  const char *const finishing[2] = {"kernel that finishes closest hits", "kernel that finishes any hits"},
                    *const of_rounds[2] = {"closest-hit kernel of masks", "any-hit kernel of masks"},
                    *const *kernels = is_by_rounds ? of_rounds : finishing;
  SCOPED_TRACE(content.name + (accel == GPURT_ACCEL_BVH ? ", bvh" : ", kdtree"));
  const ScenePair scenes = make_scenes(devices, content, GPURT_TRIANGLE_WATERTIGHT, accel);
  const bool is_short = is_short_form();
  std::vector<gpurt_ray> rays =
      is_short && is_by_rounds ? make_rays(scenes.targets, 0, 4'000) : rays_of_a_launch(scenes.targets);
  rays[7].origin[0] = 1e20f;  // far away: not for the fast kernels
  rays[1000].direction[1] = std::numeric_limits<float>::quiet_NaN();
  const std::vector<gpurt_hit> closest = trace_closest(scenes.reference, rays);
  const std::vector<uint8_t> any = trace_any(scenes.reference, rays);
  uint64_t num_hits = 0;
  for (const gpurt_hit &hit : closest) num_hits += hit.primitive != GPURT_INVALID_ID;
  EXPECT_GT(num_hits, rays.size() / amount(10, is_by_rounds ? 10 : 320));
  // In the short form one order that kernels are told and one that they find; small batches go by the kernels of the third.
  std::vector<gpurt_coherence> orders = {GPURT_COHERENCE_COHERENT, GPURT_COHERENCE_INCOHERENT,
                                         GPURT_COHERENCE_AUTO};
  if (is_short) orders.erase(orders.begin(), orders.begin() + (is_by_rounds ? 2 : 1));
  for (const gpurt_coherence coherence : orders) {
    const uint64_t num_launches[2] = {launches_of(devices.tested, kernels[0]),
                                      launches_of(devices.tested, kernels[1])};
    commit(scenes.tested, accel);
    const std::vector<gpurt_hit> tested = trace_closest(scenes.tested, rays, coherence);
    uint64_t num_different = 0;
    for (size_t i = 0; i < rays.size(); ++i) {
      if (same_bits(tested[i], closest[i]) || ++num_different > 4) continue;
      ADD_FAILURE() << "ray " << i << " (" << ray_kind_name(i) << "): " << describe(rays[i])
                    << "\n  expected " << describe(closest[i]) << "\n  but      " << describe(tested[i]);
    }
    EXPECT_EQ(num_different, 0u) << "coherence " << coherence;
    commit(scenes.tested, accel);
    EXPECT_TRUE(trace_any(scenes.tested, rays, coherence) == any) << "coherence " << coherence;
    if (coherence == GPURT_COHERENCE_INCOHERENT || is_by_rounds) {
      EXPECT_GT(launches_of(devices.tested, kernels[0]), num_launches[0]);
    }
    EXPECT_GT(launches_of(devices.tested, kernels[1]), num_launches[1]);
  }
}

TEST(CudaCoherence, DoesNotChangeHits)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const DevicePair devices = cpu_and_cuda();
  compare_orders(devices, test_scenes()[0], GPURT_ACCEL_KDTREE);
  compare_orders(devices, test_scenes()[0], GPURT_ACCEL_BVH);
}

// Leaves that lie in one plane, several at the same t, and more of them behind one another than there are rounds.
RayTargets fill_stacked_leaves(gpurt_scene scene)
{
  RayTargets targets = fill_leaves(scene, Leaves::Mask, false);
  const uint32_t masked = 1;  // the material's id
  Mesh stack;
  for (int i = 0; i < 90; ++i) {
    const float z = 6.0f + 0.05f * float(i / 3);  // three in one place
    stack.append(quad({-4, 0, z}, {4, 0, z}, {4, 4, z}, {-4, 4, z}));
  }
  std::vector<std::array<float, 2>> uvs;
  for (int i = 0; i < 90; ++i) {
    // Holes in nearly all of it.
    const float u = float(i % 7) / 64, v = float(i % 5) / 64;
    uvs.insert(uvs.end(), {{u, v}, {u + 0.02f, v}, {u + 0.02f, v + 0.02f}, {u, v + 0.02f}});
  }
  gpurt_mesh_desc desc = GPURT_MESH_DESC_INIT;
  desc.material = masked;
  desc.vertices.data = stack.vertices.data();
  desc.vertices.count = stack.vertices.size();
  desc.indices.data = stack.triangles.data();
  desc.indices.count = stack.triangles.size();
  desc.uvs.data = uvs.data();
  desc.uvs.count = uvs.size();
  uint32_t geometry;
  GPURT_EXPECT_OK(gpurt_scene_add_mesh(scene, &desc, &geometry));
  place(scene, geometry, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0});
  targets.mesh.append(stack);
  set_bounds(targets);
  return targets;
}

TEST(CudaCoherence, DoesNotChangeHitsAmongMasks)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const DevicePair devices = cpu_and_cuda();
  for (const TestScene &content :
       {TestScene{"veils", fill_veils}, TestScene{"stacked leaves", fill_stacked_leaves}})
    compare_orders(devices, content, GPURT_ACCEL_BVH, true);
}

TEST(CudaCoherence, DoesNotChangeHitsAmongPlacements)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const DevicePair devices = cpu_and_cuda();
  for (const TestScene &content :
       {TestScene{"city", fill_city}, TestScene{"foliage", fill_foliage},
        TestScene{"shared_veils", fill_shared_veils}, TestScene{"grove", fill_grove}}) {
    if (is_short_form() && content.name == "foliage") continue;  // masks are placed in the grove, too
    compare_orders(devices, content, GPURT_ACCEL_BVH);
  }
}

TEST(CudaFastBvhs, AreRefittedToVerticesThatMove)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const DevicePair devices = cpu_and_cuda();
  ScenePair pair;
  Mesh mesh = icosphere(6);
  GPURT_ASSERT_OK(gpurt_scene_create(devices.reference, pair.reference.out()));
  GPURT_ASSERT_OK(gpurt_scene_create(devices.tested, pair.tested.out()));
  for (Scene *scene : {&pair.reference, &pair.tested}) add_mesh(*scene, mesh);
  commit_fast(pair.tested);
  const gpurt_scene_facts built = facts_of(pair.tested);
  const auto move = [&](auto &&map) {
    mesh.map(map);
    gpurt_array vertices{};
    vertices.data = mesh.vertices.data();
    vertices.count = mesh.vertices.size();
    for (Scene *scene : {&pair.reference, &pair.tested}) {
      GPURT_EXPECT_OK(gpurt_scene_set_vertices(*scene, 0, &vertices, nullptr));
      commit_fast(*scene);
    }
    pair.targets.mesh = mesh;
    set_bounds(pair.targets);
    EXPECT_GT(compare_queries(pair, amount(1'000'000, 3'000)), amount(40'000, 120));
  };
  // Little by little the tree stays good.
  for (int frame = 0; frame < 3; ++frame) {
    move([](Vec v) { return Vec{v[0] * 1.02f + 0.01f * v[1], v[1], v[2] - 0.02f * v[0]}; });
    const gpurt_scene_facts facts = facts_of(pair.tested);
    EXPECT_EQ(facts.tree_refitted, 1u);
    EXPECT_EQ(facts.num_nodes, built.num_nodes);
    EXPECT_EQ(facts.num_references, built.num_references);
    EXPECT_EQ(facts_of(pair.reference).tree_refitted, 0u);
  }
  // Turned inside out, halves of it change places: built anew.
  Random random(12);
  move([&](Vec v) {
    const float side = random.below(2) ? 1.0f : -1.0f;
    return Vec{side * v[0], v[1], v[2]};
  });
  EXPECT_EQ(facts_of(pair.tested).tree_refitted, 0u);
  // Another mesh: other triangles.
  move([](Vec v) { return v; });
  EXPECT_EQ(facts_of(pair.tested).tree_refitted, 1u);
  for (Scene *scene : {&pair.reference, &pair.tested}) {
    add_mesh(*scene, icosphere(2));
    commit_fast(*scene);
  }
  EXPECT_EQ(facts_of(pair.tested).tree_refitted, 0u);
}

// Threads that use one device, and one scene, at the same time get what they get alone.
TEST(CudaThreads, TraceSideBySide)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const DevicePair devices = cpu_and_cuda();
  const std::vector<TestScene> contents = test_scenes();
  const ScenePair a = make_scenes(devices, contents[0], GPURT_TRIANGLE_WATERTIGHT);
  const ScenePair b = make_scenes(devices, contents[2], GPURT_TRIANGLE_WATERTIGHT, GPURT_ACCEL_BVH);
  std::thread threads[] = {std::thread([&] { compare_queries(a, 1'000'000); }),
                           std::thread([&] { compare_queries(b, 1'000'000); }),
                           std::thread([&] { compare_queries(a, 300'000); }),
                           std::thread([&] { compare_all_hits(b, 30'000); })};
  for (std::thread &t : threads) t.join();
}

}  // namespace
}  // namespace gpurt_test
