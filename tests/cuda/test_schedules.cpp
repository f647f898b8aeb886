// Every schedule gives the hits of the default one, bit for bit, and every schedule has really run: what it counts is
// not zero, and its kernels are among those that were launched.
#include <cstdio>

#include "gpurt_cuda.h"
#include "kernel_launches.h"
#include "pictures.h"

namespace gpurt_test {
namespace {

using Counters = gpurt_schedule_counters;

gpurt_schedule make_schedule(gpurt_traversal traversal, gpurt_launch launch = GPURT_LAUNCH_REGULAR,
                             gpurt_fetch fetch = GPURT_FETCH_PER_THREAD)
{
  gpurt_schedule s = GPURT_SCHEDULE_INIT;
  s.traversal = traversal;
  s.launch = launch;
  s.fetch = fetch;
  return s;
}

template <class T>
struct Answers {
  std::vector<T> values;
  Counters counters = GPURT_SCHEDULE_COUNTERS_INIT;
};

template <class T>
Answers<T> trace(gpurt_scene scene, gpurt_query query, gpurt_hit_format format,
                 const std::vector<gpurt_ray> &rays, const gpurt_schedule &schedule,
                 bool counts_lanes = false)
{
  Answers<T> answers;
  answers.values.resize(rays.size());
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.query = query;
  desc.format = format;
  desc.num_rays = rays.size();
  desc.rays = rays.data();
  if (query == GPURT_QUERY_ANY) desc.occluded = reinterpret_cast<uint8_t *>(answers.values.data());
  else desc.hits = answers.values.data();
  desc.schedule = schedule;
  desc.out_counters = &answers.counters;
  desc.count_lanes = counts_lanes ? 1 : 0;
  GPURT_EXPECT_OK(gpurt_scene_trace(scene, &desc));
  return answers;
}

template <class T>
uint64_t num_differences(const std::vector<T> &a, const std::vector<T> &b)
{
  uint64_t n = 0;
  for (size_t i = 0; i < a.size(); ++i) n += std::memcmp(&a[i], &b[i], sizeof(T)) != 0;
  return n;
}

std::vector<gpurt_ray> make_rays(const RayTargets &targets, uint64_t count)
{
  std::vector<gpurt_ray> rays(count);
  for (uint64_t i = 0; i < count; ++i) rays[i] = make_ray(targets, i);
  return rays;
}

/// A schedule with what must not be zero once it has run, and a word of its kernel's name.
struct QuerySchedule {
  const char *name;
  gpurt_schedule schedule;
  std::vector<uint64_t Counters::*> counts;
  const char *kernel;
};

std::vector<QuerySchedule> query_schedules()
{
  const auto regular = GPURT_LAUNCH_REGULAR;
  const auto persistent = GPURT_LAUNCH_PERSISTENT;
  return {
      {"persistent",
       make_schedule(GPURT_TRAVERSAL_STACK, persistent),
       {&Counters::ray_refills},
       "kernel of persistent threads with stacks"},
      {"leaf lists",
       make_schedule(GPURT_TRAVERSAL_LEAF_LISTS, regular),
       {&Counters::list_rounds, &Counters::list_overflows},
       "kernel that selects leaves"},
      {"leaf lists, persistent",
       make_schedule(GPURT_TRAVERSAL_LEAF_LISTS, persistent),
       {&Counters::list_rounds, &Counters::list_overflows, &Counters::ray_refills},
       "kernel that tests listed leaves, persistent threads"},
      {"uber",
       make_schedule(GPURT_TRAVERSAL_UBER, regular),
       {&Counters::mode_switches},
       "uber-kernel of a query"},
      {"uber, persistent",
       make_schedule(GPURT_TRAVERSAL_UBER, persistent),
       {&Counters::mode_switches, &Counters::ray_refills},
       "uber-kernel of a query, persistent threads"},
      {"packets",
       make_schedule(GPURT_TRAVERSAL_STACK, regular, GPURT_FETCH_PACKETS),
       {&Counters::packets, &Counters::shared_triangles},
       "kernel of packets"},
      {"packets, persistent",
       make_schedule(GPURT_TRAVERSAL_STACK, persistent, GPURT_FETCH_PACKETS),
       {&Counters::packets, &Counters::shared_triangles, &Counters::ray_refills},
       "kernel of packets, persistent threads"},
  };
}

// How often kernels of the name were started, which have sensible registers and occupancy.
uint64_t checked_launches_of(gpurt_device device, const std::string &name)
{
  uint64_t n = 0;
  for (const gpurt_cuda_kernel &k : kernels_of(device)) {
    if (name != k.name) continue;
    n += k.num_launches;
    EXPECT_GT(k.registers, 0u) << name;
    EXPECT_GT(k.occupancy, 0.0f) << name;
    EXPECT_LE(k.occupancy, 1.0f) << name;
  }
  return n;
}

/// Those that a bvh has.
std::vector<QuerySchedule> bvh_query_schedules() { return {query_schedules()[0]}; }

void compare_schedules(gpurt_device device, const TestScene &content, uint64_t num_rays,
                       gpurt_accel accel = GPURT_ACCEL_KDTREE,
                       gpurt_triangle_test test = GPURT_TRIANGLE_WATERTIGHT)
{
  SCOPED_TRACE(content.name);
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  RayTargets targets = content.fill(scene);
  commit(scene, GPURT_ACCEL_KDTREE);
  targets.planes = split_planes(scene);
  if (accel != GPURT_ACCEL_KDTREE) commit(scene, accel, test);
  const std::vector<gpurt_ray> rays = make_rays(targets, num_rays);
  const gpurt_schedule plain = make_schedule(GPURT_TRAVERSAL_STACK);
  const auto full = trace<gpurt_hit>(scene, GPURT_QUERY_CLOSEST, GPURT_HIT_FULL, rays, plain);
  const auto compact = trace<gpurt_hit_compact>(scene, GPURT_QUERY_CLOSEST, GPURT_HIT_COMPACT, rays, plain);
  const auto any = trace<uint8_t>(scene, GPURT_QUERY_ANY, GPURT_HIT_FULL, rays, plain);
  EXPECT_GT(full.counters.device_ns, 0u);
  EXPECT_EQ(full.counters.ray_refills + full.counters.list_rounds + full.counters.mode_switches +
                full.counters.packets,
            0u);
  for (const QuerySchedule &q : accel == GPURT_ACCEL_BVH ? bvh_query_schedules() : query_schedules()) {
    SCOPED_TRACE(q.name);
    const uint64_t launches = checked_launches_of(device, q.kernel);
    const auto a = trace<gpurt_hit>(scene, GPURT_QUERY_CLOSEST, GPURT_HIT_FULL, rays, q.schedule);
    const auto b = trace<gpurt_hit_compact>(scene, GPURT_QUERY_CLOSEST, GPURT_HIT_COMPACT, rays, q.schedule);
    const auto c = trace<uint8_t>(scene, GPURT_QUERY_ANY, GPURT_HIT_FULL, rays, q.schedule);
    EXPECT_EQ(num_differences(a.values, full.values), 0u);
    EXPECT_EQ(num_differences(b.values, compact.values), 0u);
    EXPECT_EQ(num_differences(c.values, any.values), 0u);
    EXPECT_GT(checked_launches_of(device, q.kernel), launches);
    // The world's tree of a scene of shared geometries may be too small for a list of leaves to overflow.
    for (const auto count : q.counts) {
      if (count == &Counters::list_overflows && content.name == "city") continue;
      EXPECT_GT(a.counters.*count, 0u);
      if (count != &Counters::list_overflows) {
        EXPECT_GT(c.counters.*count, 0u);
      }
    }
    std::printf("%s, %s: closest %.3f ms, any %.3f ms (default %.3f, %.3f)\n", content.name.c_str(), q.name,
                double(a.counters.device_ns) * 1e-6, double(c.counters.device_ns) * 1e-6,
                double(full.counters.device_ns) * 1e-6, double(any.counters.device_ns) * 1e-6);
  }
}

TEST(CudaSchedules, OfQueriesGiveTheSameHits)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  for (const TestScene &content : scenes_of_each_kind())
    compare_schedules(device, content, amount(1'000'003, 2'003));
}

// Persistent threads walk bvhs, too: by the fast kernels where these serve the scene, else a warp's rays to their ends.
TEST(CudaSchedules, OfQueriesInBvhsGiveTheSameHits)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  for (const TestScene &content : scenes_of_each_kind())
    compare_schedules(device, content, amount(600'011, 2'003), GPURT_ACCEL_BVH);
  for (const gpurt_triangle_test test : {GPURT_TRIANGLE_MOLLER_TRUMBORE, GPURT_TRIANGLE_DOUBLE})
    compare_schedules(device, test_scenes()[0], amount(100'003, 1'003), GPURT_ACCEL_BVH, test);
}

double active_lanes(const Counters &c) { return double(c.lane_steps) / (32 * double(c.warp_steps)); }

// Of a warp whose rays are one and the same all lanes work, of one with a single ray that hits something one of 32; and
// whatever the rays, kernels that count lanes find the hits that the others do.
void compare_counting(gpurt_device device, const TestScene &content, gpurt_accel accel, uint64_t num_rays)
{
  SCOPED_TRACE(content.name);
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  const RayTargets targets = content.fill(scene);
  commit(scene, accel);
  const std::vector<gpurt_ray> rays = make_rays(targets, num_rays);
  const gpurt_schedule plain = make_schedule(GPURT_TRAVERSAL_STACK);
  const auto expected = trace<gpurt_hit>(scene, GPURT_QUERY_CLOSEST, GPURT_HIT_FULL, rays, plain);
  EXPECT_EQ(expected.counters.warp_steps + expected.counters.lane_steps, 0u);
  uint64_t seen = 0;
  while (expected.values.at(seen).primitive == GPURT_INVALID_ID) ++seen;
  // Batches of whole warps, too small for those that look at the order of rays.
  const std::vector<gpurt_ray> alike(4096, rays[seen]);
  gpurt_ray nothing = rays[seen];
  for (float &d : nothing.direction) d = 0;
  std::vector<gpurt_ray> single(4096, nothing);
  for (size_t i = 0; i < single.size(); i += 32) single[i + 7] = rays[seen];
  std::vector<QuerySchedule> schedules = accel == GPURT_ACCEL_BVH ? bvh_query_schedules() : query_schedules();
  schedules.insert(schedules.begin(), {"stack", plain, {}, ""});
  schedules.push_back({"auto", GPURT_SCHEDULE_INIT, {}, ""});
  for (const QuerySchedule &q : schedules) {
    SCOPED_TRACE(q.name);
    const auto counted = trace<gpurt_hit>(scene, GPURT_QUERY_CLOSEST, GPURT_HIT_FULL, rays, q.schedule, true);
    EXPECT_EQ(num_differences(counted.values, expected.values), 0u);
    EXPECT_GT(counted.counters.lane_steps, counted.counters.warp_steps);
    EXPECT_LT(counted.counters.lane_steps, 32 * counted.counters.warp_steps);
    for (const auto count : q.counts) {
      if (count != &Counters::list_overflows) {
        EXPECT_GT(counted.counters.*count, 0u);
      }
    }
    // Under a sanitizer lanes of a warp come apart where they would not.
    const bool is_sanitized = is_short_form();
    if (is_sanitized) continue;
    const auto of_alike =
        trace<gpurt_hit>(scene, GPURT_QUERY_CLOSEST, GPURT_HIT_FULL, alike, q.schedule, true);
    EXPECT_EQ(of_alike.counters.lane_steps, 32 * of_alike.counters.warp_steps);
    // Lists put rays of several warps together in their second round, and persistent threads draw them.
    if (q.schedule.launch == GPURT_LAUNCH_REGULAR && q.schedule.traversal != GPURT_TRAVERSAL_LEAF_LISTS) {
      const auto of_single =
          trace<gpurt_hit>(scene, GPURT_QUERY_CLOSEST, GPURT_HIT_FULL, single, q.schedule, true);
      EXPECT_EQ(of_single.counters.lane_steps, of_single.counters.warp_steps);
      // As many steps as a warp of such rays takes together.
      EXPECT_EQ(of_single.counters.warp_steps, of_alike.counters.warp_steps);
    }
    std::printf("%s, %s: %.1f lanes\n", content.name.c_str(), q.name, 32 * active_lanes(counted.counters));
  }
}

TEST(CudaSchedules, CountLanesThatWork)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  for (const TestScene &content : scenes_of_each_kind()) {
    for (const gpurt_accel accel : {GPURT_ACCEL_KDTREE, GPURT_ACCEL_BVH})
      compare_counting(device, content, accel, amount(300'007, 1'003));
  }
}

TEST(CudaSchedules, RefuseToCountLanesOfOtherTests)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  test_scenes()[0].fill(scene);
  commit(scene, GPURT_ACCEL_BVH, GPURT_TRIANGLE_DOUBLE);
  const gpurt_ray ray = {{0, 0, 5}, 0, {0, 0, -1}, 10};
  gpurt_hit hit;
  Counters counters = GPURT_SCHEDULE_COUNTERS_INIT;
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.num_rays = 1;
  desc.rays = &ray;
  desc.hits = &hit;
  desc.count_lanes = 1;
  desc.out_counters = &counters;
  EXPECT_EQ(gpurt_scene_trace(scene, &desc), GPURT_ERROR_UNSUPPORTED);
  EXPECT_NE(std::string(gpurt_last_error()).find("GPURT_TRIANGLE_WATERTIGHT"), std::string::npos)
      << gpurt_last_error();
}

// Lists of leaves take what memory there is.
TEST(CudaSchedules, OfQueriesWorkInLittleMemory)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  compare_schedules(make_device(GPURT_DEVICE_CUDA, 0, uint64_t(64) << 20), test_scenes()[0],
                    amount(100'000, 2'003));
}

void expect_refused(gpurt_scene scene, gpurt_query query, const gpurt_schedule &schedule, const char *part)
{
  const gpurt_ray ray = {{0, 0, 5}, 0, {0, 0, -1}, 10};
  gpurt_hit hit;
  uint64_t offsets[2];
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.query = query;
  desc.num_rays = 1;
  desc.rays = &ray;
  if (query == GPURT_QUERY_ALL) desc.offsets = offsets;
  else desc.hits = &hit;
  desc.schedule = schedule;
  EXPECT_EQ(gpurt_scene_trace(scene, &desc), GPURT_ERROR_UNSUPPORTED) << part;
  EXPECT_NE(std::string(gpurt_last_error()).find(part), std::string::npos) << gpurt_last_error();
}

TEST(CudaSchedules, ThatDoNotExistAreRefusedWithARemedy)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  test_scenes()[0].fill(scene);
  commit(scene, GPURT_ACCEL_KDTREE);
  expect_refused(scene, GPURT_QUERY_ALL, make_schedule(GPURT_TRAVERSAL_UBER), "GPURT_QUERY_ALL");
  expect_refused(scene, GPURT_QUERY_CLOSEST,
                 make_schedule(GPURT_TRAVERSAL_UBER, GPURT_LAUNCH_REGULAR, GPURT_FETCH_PACKETS),
                 "use GPURT_TRAVERSAL_STACK");
  gpurt_schedule sorted = GPURT_SCHEDULE_INIT;
  sorted.shading = GPURT_SHADING_SORTED;
  expect_refused(scene, GPURT_QUERY_CLOSEST, sorted, "shading");
  commit(scene, GPURT_ACCEL_BVH);
  expect_refused(scene, GPURT_QUERY_CLOSEST, make_schedule(GPURT_TRAVERSAL_LEAF_LISTS), "GPURT_ACCEL_KDTREE");
  commit(scene, GPURT_ACCEL_KDTREE, GPURT_TRIANGLE_DOUBLE);
  expect_refused(scene, GPURT_QUERY_CLOSEST, make_schedule(GPURT_TRAVERSAL_LEAF_LISTS),
                 "GPURT_TRIANGLE_WATERTIGHT");
}

/// Every schedule that a render can have, but those that a bvh has not.
std::vector<QuerySchedule> render_schedules(gpurt_accel accel)
{
  std::vector<QuerySchedule> all = bvh_query_schedules();
  if (accel == GPURT_ACCEL_KDTREE) {
    all = query_schedules();
    std::erase_if(all, [](const QuerySchedule &q) { return q.schedule.traversal == GPURT_TRAVERSAL_UBER; });
  }
  const auto add = [&](const char *name, std::vector<uint64_t Counters::*> counts, const char *kernel,
                       auto change) {
    gpurt_schedule s = GPURT_SCHEDULE_INIT;
    change(s);
    all.push_back({name, s, std::move(counts), kernel});
  };
  add("uber", {&Counters::mode_switches}, "uber-kernel of paths", [](auto &s) {
    s.traversal = GPURT_TRAVERSAL_UBER;
    s.launch = GPURT_LAUNCH_REGULAR;
  });
  add("uber, persistent", {&Counters::mode_switches, &Counters::ray_refills}, "uber-kernel of paths",
      [](auto &s) {
        s.traversal = GPURT_TRAVERSAL_UBER;
        s.launch = GPURT_LAUNCH_PERSISTENT;
      });
  add("pyramid", {&Counters::compactions}, "kernel that goes down a histogram pyramid",
      [](auto &s) { s.compaction = GPURT_COMPACTION_PYRAMID; });
  add("naive scan", {&Counters::compactions}, "kernel of the naive scan",
      [](auto &s) { s.compaction = GPURT_COMPACTION_NAIVE_SCAN; });
  add("library scan", {&Counters::compactions}, "kernel that stores a scan's total",
      [](auto &s) { s.compaction = GPURT_COMPACTION_LIBRARY_SCAN; });
  add("sorted", {&Counters::sorted_hits}, "path stage 'shade', sorted by material",
      [](auto &s) { s.shading = GPURT_SHADING_SORTED; });
  add("slots", {}, "path stage 'shade'", [](auto &s) { s.generation = GPURT_GENERATION_SLOTS; });
  add("refilled", {}, "kernel that shades a pool's paths",
      [](auto &s) { s.generation = GPURT_GENERATION_REFILLED; });
  add("counted", {&Counters::counted_rays}, "kernel that counts the rays of materials and lights",
      [](auto &s) { s.generation = GPURT_GENERATION_COUNTED; });
  add("counted, pyramid, split", {&Counters::counted_rays, &Counters::wave_splits},
      "kernel that makes the counted rays", [](auto &s) {
        s.generation = GPURT_GENERATION_COUNTED;
        s.compaction = GPURT_COMPACTION_PYRAMID;
        s.ray_budget = amount(1500, 100);  // of the short form's 192 paths: a split or three
      });
  add("counted, naive scan", {&Counters::counted_rays}, "kernel that makes the counted rays", [](auto &s) {
    s.generation = GPURT_GENERATION_COUNTED;
    s.compaction = GPURT_COMPACTION_NAIVE_SCAN;
  });
  return all;
}

void submit_and_wait(gpurt_frame frame, const RenderOptions &o, const gpurt_schedule &schedule)
{
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.samples_per_pixel = o.spp;
  desc.max_depth = o.max_depth;
  desc.tile_size = o.tile_size;
  desc.schedule = schedule;
  Job job;
  GPURT_ASSERT_OK(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()));
  GPURT_ASSERT_OK(gpurt_job_wait(job, GPURT_WAIT_FOREVER));
}

void compare_renders(gpurt_device device, void (*fill)(gpurt_scene), gpurt_accel accel, uint32_t outputs,
                     const RenderOptions &o)
{
  SCOPED_TRACE(accel == GPURT_ACCEL_BVH ? "bvh" : "kdtree");
  const Scene scene = make_scene(device, fill, accel);
  const Frame expected = make_frame(scene, o, outputs);
  submit_and_wait(expected, o, GPURT_SCHEDULE_INIT);
  const gpurt_statistics s = statistics(expected);
  EXPECT_EQ(s.schedule.traversal, GPURT_TRAVERSAL_STACK);
  const bool has_fast_kernels = fill == fill_cornell_box;  // no masks, no shared geometries
  EXPECT_EQ(s.schedule.launch,
            accel == GPURT_ACCEL_BVH || has_fast_kernels ? GPURT_LAUNCH_REGULAR : GPURT_LAUNCH_PERSISTENT);
  EXPECT_NE(s.schedule.compaction, GPURT_COMPACTION_AUTO);
  EXPECT_GT(s.num_shadow_rays, 0u);
  const auto color = [&](gpurt_frame frame) {
    std::vector<uint32_t> words(size_t(o.width) * o.height * 3);
    GPURT_EXPECT_OK(gpurt_frame_read(frame, GPURT_OUTPUT_COLOR, words.data(), words.size() * 4));
    return words;
  };
  for (const QuerySchedule &q : render_schedules(accel)) {
    SCOPED_TRACE(q.name);
    const uint64_t launches = checked_launches_of(device, q.kernel);
    const Frame frame = make_frame(scene, o, outputs);
    submit_and_wait(frame, o, q.schedule);
    if (outputs != 0) expect_same(read_all(expected, o), read_all(frame, o));
    else EXPECT_EQ(color(expected), color(frame));
    EXPECT_GT(checked_launches_of(device, q.kernel), launches);
    const gpurt_statistics t = statistics(frame);
    for (const auto count : q.counts) {
      if (count != &Counters::list_overflows) {
        EXPECT_GT(t.schedule_counters.*count, 0u);
      }
    }
    EXPECT_EQ(t.num_samples, s.num_samples);
    EXPECT_EQ(t.num_camera_rays, s.num_camera_rays);
    EXPECT_EQ(t.num_bounce_rays, s.num_bounce_rays);
    EXPECT_EQ(t.num_shadow_rays, s.num_shadow_rays);
    EXPECT_EQ(t.largest_sample, s.largest_sample);
    if (q.schedule.generation == GPURT_GENERATION_COUNTED) {
      EXPECT_EQ(t.schedule_counters.counted_rays, s.num_bounce_rays + s.num_shadow_rays);
    }
    std::printf("%s: %.2f ms (default %.2f)\n", q.name, t.render_seconds * 1e3, s.render_seconds * 1e3);
  }
}

// Of every scene by every schedule. In the short form of a box, of what has all that others have, and of media.
void compare_renders(gpurt_accel accel)
{
  const Device device = make_device(GPURT_DEVICE_CUDA);
  const bool is_whole = !is_short_form();
  RenderOptions o;
  o.width = uint32_t(amount(157, 16));
  o.height = uint32_t(amount(121, 12));
  o.spp = uint32_t(amount(8, 1));
  o.max_depth = uint32_t(amount(0, 4));
  o.seed = 42;
  compare_renders(device, fill_cornell_box, accel, 0, o);
  if (is_whole) compare_renders(device, fill_everything, accel, all_outputs, o);
  if (is_whole) compare_renders(device, fill_veiled_box, accel, 0, o);
  compare_renders(device, fill_veiled_everything, accel, all_outputs, o);
  compare_renders(device, fill_tinted_box, accel, all_outputs, o);
}

TEST(CudaSchedules, OfRendersGiveTheSameImages)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  compare_renders(GPURT_ACCEL_KDTREE);
}

TEST(CudaSchedules, OfRendersInBvhsGiveTheSameImages)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  compare_renders(GPURT_ACCEL_BVH);
}

// Tiles are what is handed out and delivered; the image does not know.
TEST(CudaSchedules, OfTilesGiveTheSameImages)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  const Scene scene = make_scene(device, fill_cornell_box);
  RenderOptions o;
  o.width = o.height = 300;
  o.spp = 4;
  const Frame expected = make_frame(scene, o, all_outputs);
  render(expected, o);
  for (const uint32_t tile : {128u, 256u}) {
    o.tile_size = tile;
    const Frame frame = make_frame(scene, o, all_outputs);
    render(frame, o);
    expect_same(read_all(expected, o), read_all(frame, o));
    EXPECT_EQ(statistics(frame).tile_size, tile);
  }
}

// A small budget makes the wave split and its queues small.
TEST(CudaSchedules, BudgetOfRaysBoundsMemory)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  RenderOptions o;
  // So large that the queues are most of what is held at once.
  o.width = o.height = uint32_t(amount(512, 256));
  o.spp = 4;
  uint64_t peaks[2];
  for (int i = 0; i < 2; ++i) {
    const Device device = make_device(GPURT_DEVICE_CUDA);
    const Scene scene = make_scene(device, fill_cornell_box);
    const Frame frame = make_frame(scene, o);
    gpurt_schedule schedule = GPURT_SCHEDULE_INIT;
    schedule.generation = GPURT_GENERATION_COUNTED;
    schedule.ray_budget = i == 0 ? 0 : amount(1 << 16, 1 << 14);
    submit_and_wait(frame, o, schedule);
    const gpurt_statistics s = statistics(frame);
    EXPECT_EQ(s.schedule.ray_budget, schedule.ray_budget);
    EXPECT_EQ(s.schedule_counters.wave_splits != 0, i == 1);
    peaks[i] = s.memory_peak_bytes;
  }
  EXPECT_LT(peaks[1], peaks[0]);
}

// A pool that is smaller than the picture starts paths where others have ended. How many samples a pass takes depends on how long
// others took, but for the first one: of its single sample there is room for half of the paths, with 192 bytes for a pixel of the
// film and some 300 for a path.
TEST(CudaSchedules, PoolsRefillInLittleMemory)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  RenderOptions o;
  o.width = o.height = uint32_t(amount(256, 192));
  o.max_depth = uint32_t(amount(0, 4));
  const uint64_t little = uint64_t(o.width) * o.height * 420, more = uint64_t(64) << 20;
  for (const uint64_t limit : {little, more}) {
    SCOPED_TRACE(limit);
    o.spp = limit == little ? 1 : 16;
    if (o.spp != 1 && is_short_form()) continue;
    std::vector<std::vector<OutputBits>> pictures;
    for (const uint64_t its_limit : {uint64_t(0), limit}) {
      const Device device = make_device(GPURT_DEVICE_CUDA, 0, its_limit);
      const Scene scene = make_scene(device, fill_cornell_box);
      const Frame frame = make_frame(scene, o, all_outputs);
      render(frame, o);
      const gpurt_statistics s = statistics(frame);
      EXPECT_EQ(s.schedule.generation, GPURT_GENERATION_REFILLED);
      if (its_limit != 0) {
        EXPECT_LE(s.memory_peak_bytes, its_limit);
      }
      if (its_limit == little) {
        EXPECT_GT(s.schedule_counters.path_refills, 0u);
      }
      pictures.push_back(read_all(frame, o));
    }
    expect_same(pictures[0], pictures[1]);
  }
}

TEST(Schedules, OfTilesOfTheCpuGiveTheSameImages)
{
  const Device device = make_device(GPURT_DEVICE_CPU);
  const Scene scene = make_scene(device, fill_cornell_box);
  RenderOptions o;
  o.width = o.height = 300;
  o.spp = 1;
  const Frame expected = make_frame(scene, o, all_outputs);
  render(expected, o);
  o.tile_size = 256;
  const Frame frame = make_frame(scene, o, all_outputs);
  render(frame, o);
  expect_same(read_all(expected, o), read_all(frame, o));
}

TEST(Schedules, OfTheCpuAreTheFusedOnes)
{
  const Device device = make_device(GPURT_DEVICE_CPU);
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  test_scenes()[0].fill(scene);
  add_camera(scene, {0, 0, 4}, 0.7f);
  commit(scene, GPURT_ACCEL_KDTREE);
  for (const QuerySchedule &q : query_schedules())
    expect_refused(scene, GPURT_QUERY_CLOSEST, q.schedule, "the CPU device");
  const std::vector<gpurt_ray> rays = {{{0, 0, 5}, 0, {0, 0, -1}, 10}};
  const auto hits = trace<gpurt_hit>(scene, GPURT_QUERY_CLOSEST, GPURT_HIT_FULL, rays,
                                     make_schedule(GPURT_TRAVERSAL_STACK));
  EXPECT_NE(hits.values[0].primitive, GPURT_INVALID_ID);

  const Frame frame = make_frame(scene, RenderOptions{});
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.schedule.generation = GPURT_GENERATION_COUNTED;
  Job job;
  EXPECT_EQ(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()), GPURT_ERROR_UNSUPPORTED);
  EXPECT_NE(std::string(gpurt_last_error()).find("schedule.generation"), std::string::npos);
  desc.schedule = GPURT_SCHEDULE_INIT;
  desc.samples_per_pixel = 1;
  GPURT_ASSERT_OK(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()));
  GPURT_ASSERT_OK(gpurt_job_wait(job, GPURT_WAIT_FOREVER));
  gpurt_statistics s = GPURT_STATISTICS_INIT;
  GPURT_ASSERT_OK(gpurt_frame_get_statistics(frame, &s));
  EXPECT_EQ(s.schedule.traversal, GPURT_TRAVERSAL_STACK);
  EXPECT_EQ(s.schedule.generation, GPURT_GENERATION_SLOTS);
  uint32_t count;
  EXPECT_EQ(gpurt_cuda_get_kernels(device, nullptr, 0, &count), GPURT_ERROR_UNSUPPORTED);
}

}  // namespace
}  // namespace gpurt_test
