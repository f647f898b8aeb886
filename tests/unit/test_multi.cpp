// Several devices that work as one: the same image and hits as one of them, whatever the share of each; failures that name
// their device; memory that adds up. Devices are CPUs, or fakes that are slow, short of memory or broken.
#include <numeric>

#include "accel_test.h"
#include "cpu/factory.h"
#include "frame/outputs.h"
#include "multi/multi_backend.h"
#include "multi/shared_work.h"
#include "scene/validate.h"
#include "test_frame_fake.h"

namespace gpurt_test {
namespace {

using namespace gpurt::test;

std::string message_of(const std::function<void()> &work, gpurt_result result)
{
  try {
    work();
  } catch (const Error &e) {
    EXPECT_EQ(e.result(), result) << e.what();
    return e.what();
  }
  ADD_FAILURE() << "no error";
  return "";
}

/// A device whose scene is a FakeScene, or one that a test makes of it.
class FakeBackend : public Backend {
 public:
  FakeBackend(uint32_t ordinal, std::shared_ptr<CommittedScene> scene, uint64_t limit = 0)
      : scene_(std::move(scene)), memory_(std::make_shared<MemoryTracker>(limit))
  {
    info_.type = GPURT_DEVICE_CUDA;
    info_.ordinal = ordinal;
    info_.num_threads = 1;
    info_.memory_bytes = 1000;
    info_.compute_capability = 90 - ordinal;
    info_.name = "Fake";
  }
  const DeviceInfo &info() const override { return info_; }
  const std::shared_ptr<MemoryTracker> &memory() const override { return memory_; }
  std::shared_ptr<const CommittedScene> commit(std::shared_ptr<const CompiledScene>,
                                               const BuildOptions &) override
  {
    if (!scene_) fail(GPURT_ERROR_OUT_OF_MEMORY, "no room");
    return scene_;
  }
  std::shared_ptr<void> allocate(uint64_t) override { return {}; }
  void copy_to_host(void *, const void *, uint64_t) override { num_copies++; }
  void copy_to_device(void *, const void *, uint64_t) override { num_copies++; }
  bool holds(const void *data) const override { return uintptr_t(data) >> 32 == info_.ordinal + 1; }

  int num_copies = 0;

 private:
  DeviceInfo info_;
  std::shared_ptr<CommittedScene> scene_;
  std::shared_ptr<MemoryTracker> memory_;
};

/// Counts the units of a FakeScene, whose device gives up at some pass, or has memory for one pass at a time.
class CountedScene : public CommittedScene {
 public:
  const AccelFacts &accel_facts() const override { return fake.facts; }
  HostKdTree export_tree(uint32_t) const override { return {}; }
  void trace(const TraceRequest &request) const override { num_rays += request.num_rays; }
  void require_reyes() const override {}
  ReyesSchedule resolve_reyes_schedule(const Schedule &asked, const ReyesSettings &) const override
  {
    return {asked.launch, asked.traversal};
  }
  void render(const RenderPass &pass) const override
  {
    if (pass.reyes != nullptr && pass.reyes->shading_rate == 2 &&
        pass.reyes_schedule.split == Launch::Rounds && pass.reyes_schedule.stages == Traversal::Uber) {
      num_reyes_passes++;
    }
    if (num_at_once++ > 0 && is_tight) {
      num_at_once--;
      num_refused++;
      fail(GPURT_ERROR_OUT_OF_MEMORY, "no room for a second pass");
    }
    RenderPass counted = pass;
    counted.deliver = [&](const WorkUnit &unit, const TileFilm &film, const RenderCounters &counters) {
      num_units++;
      pass.deliver(unit, film, counters);
    };
    try {
      fake.render(counted);
      while (draws_itself && !(counted.units = pass.more()).empty()) {
        num_drawn++;
        fake.render(counted);
      }
    } catch (...) {
      num_at_once--;
      throw;
    }
    num_at_once--;
  }

  FakeScene fake;
  bool is_tight = false, draws_itself = false;
  mutable std::atomic<int> num_units{0}, num_at_once{0}, num_refused{0}, num_drawn{0}, num_reyes_passes{0};
  mutable std::atomic<uint64_t> num_rays{0};
};

struct FakeDevices {
  std::vector<std::shared_ptr<CountedScene>> scenes;
  std::unique_ptr<Backend> backend;
  std::shared_ptr<const CommittedScene> committed;

  explicit FakeDevices(std::vector<int> microseconds_per_path)
  {
    std::vector<std::unique_ptr<Backend>> members;
    for (size_t i = 0; i < microseconds_per_path.size(); ++i) {
      scenes.push_back(std::make_shared<CountedScene>());
      scenes[i]->fake.num_threads = 1;
      scenes[i]->fake.path_time = std::chrono::microseconds(microseconds_per_path[i]);
      members.push_back(std::make_unique<FakeBackend>(uint32_t(i), scenes[i]));
    }
    backend = multi::join(std::move(members));
    committed = backend->commit(nullptr, {});
  }

  std::shared_ptr<Frame> make_frame(uint32_t width, uint32_t height) const
  {
    const FakeFrame fake;
    gpurt_frame_desc desc = GPURT_FRAME_DESC_INIT;
    desc.width = width;
    desc.height = height;
    desc.outputs = all_outputs;
    desc.seed = 7;
    return std::make_shared<Frame>(
        FrameScene{committed, fake.compiled, backend->memory(), backend->info().num_threads, 0.0}, desc);
  }
};

TEST(SharedWork, IsHandedOutOnceAndInShrinkingParts)
{
  multi::SharedRange range(1000, 4, 10);
  uint64_t first, count, next = 0, last = 1000;
  while (range.take(first, count)) {
    EXPECT_EQ(first, next);
    EXPECT_LE(count, last);
    EXPECT_TRUE(count >= 10 || first + count == 1000);
    next = first + count;
    last = count;
  }
  EXPECT_EQ(next, 1000u);
  EXPECT_LE(last, 10u);

  std::vector<WorkUnit> units;
  for (uint32_t i = 0; i < 100; ++i) units.push_back({i, 0, i + 1, 1, 0, 1 + i % 7});
  multi::SharedUnits queue(units, 2, 2, 20);
  size_t num_taken = 0;
  std::span<const WorkUnit> part = queue.take(0);
  EXPECT_TRUE(queue.give_back(0, part)) << "the device has another worker";
  while (!(part = queue.take(0)).empty()) num_taken += part.size();
  EXPECT_EQ(num_taken, units.size());
  EXPECT_TRUE(queue.take_more().empty());
  EXPECT_TRUE(queue.take(1).empty());
  EXPECT_FALSE(queue.give_back(1, units)) << "the last worker has nobody to leave it to";
}

TEST(SeveralDevices, RenderTheBitsOfOne)
{
  const FakeDevices one({0}), three({0, 3, 1});
  for (const auto &scene : three.scenes) scene->draws_itself = true;
  const auto a = one.make_frame(123, 77), b = three.make_frame(123, 77);
  render(a, 24, {}, 16);
  render(b, 10, {}, 13);
  render(b, 24, {}, 16);
  EXPECT_EQ(read_all(*a), read_all(*b));
  EXPECT_EQ(statistics(*a).num_samples, statistics(*b).num_samples);
  for (const auto &scene : three.scenes) EXPECT_GT(scene->num_units, 0);
  EXPECT_GT(three.scenes[0]->num_drawn + three.scenes[1]->num_drawn + three.scenes[2]->num_drawn, 0);
}

// The slow device gets what it can do in the time of the fast one.
TEST(SeveralDevices, ShareTheWorkBySpeed)
{
  const FakeDevices two({2, 10});
  const auto frame = two.make_frame(512, 512);
  render(frame, 2, {}, 32);
  const double fast = two.scenes[0]->num_units, slow = two.scenes[1]->num_units;
  EXPECT_GT(fast, 2 * slow);
  EXPECT_GT(slow, 0);
}

TEST(SeveralDevices, GoOnInOnePartAtATimeWhereMemoryIsShort)
{
  FakeDevices two({1, 1});
  for (const auto &scene : two.scenes) scene->is_tight = true;
  const FakeDevices one({0});
  const auto a = one.make_frame(200, 200), b = two.make_frame(200, 200);
  render(a, 8);
  render(b, 8);
  EXPECT_EQ(read_all(*a), read_all(*b));
  EXPECT_GT(two.scenes[0]->num_refused + two.scenes[1]->num_refused, 0);
}

TEST(SeveralDevices, NameTheOneThatFails)
{
  FakeDevices two({0, 0});
  two.scenes[1]->fake.fail_after = 1;
  const auto frame = two.make_frame(256, 256);
  const std::string text = message_of([&] { render(frame, 64, {}, 8); }, GPURT_ERROR_DEVICE);
  EXPECT_TRUE(contains(text, "CUDA device 1: the fake device fell over"));
  two.scenes[1]->fake.fail_after = 0;
  render(frame, 64);  // what was rendered is kept, the rest is rendered now
  const FakeDevices one({0});
  const auto expected = one.make_frame(256, 256);
  render(expected, 64);
  EXPECT_EQ(read_all(*frame), read_all(*expected));

  std::vector<std::unique_ptr<Backend>> members;
  members.push_back(std::make_unique<FakeBackend>(0, two.scenes[0]));
  members.push_back(std::make_unique<FakeBackend>(3, nullptr));
  const auto broken = multi::join(std::move(members));
  EXPECT_TRUE(contains(message_of([&] { broken->commit(nullptr, {}); }, GPURT_ERROR_OUT_OF_MEMORY),
                       "CUDA device 3: no room"));
}

// Every device takes passes of its own; units come whole, each once.
TEST(SeveralDevices, ShareOutPassesOfPhotonMapping)
{
  const FakeDevices one({0}), three({0, 0, 0});
  const PhotonRequest photon{};
  std::vector<WorkUnit> units;
  for (uint32_t i = 0; i < 5; ++i) units.push_back({20 * i, 3 * i, 20 * i + 17, 3 * i + 9, i, 1 + 2 * i});
  struct Delivered {
    std::map<uint32_t, std::pair<WorkUnit, TileFilm>> units;
    RenderCounters counters;
  };
  const auto render_units = [&](const FakeDevices &devices) {
    Delivered delivered;
    std::mutex mutex;
    const std::atomic<bool> cancelled{false};
    RenderPass pass;
    pass.settings = {};
    pass.outputs = all_outputs;
    pass.units = units;
    pass.photon = &photon;
    pass.cancelled = &cancelled;
    pass.deliver = [&](const WorkUnit &unit, const TileFilm &film, const RenderCounters &counters) {
      const std::lock_guard lock(mutex);
      EXPECT_TRUE(delivered.units.emplace(unit.x0, std::pair(unit, film)).second) << "came twice";
      add_counters(delivered.counters, counters);
    };
    devices.committed->render(pass);
    return delivered;
  };
  const Delivered a = render_units(one), b = render_units(three);
  ASSERT_EQ(b.units.size(), units.size());
  for (const WorkUnit &u : units) {
    const auto &[unit, film] = b.units.at(u.x0);
    EXPECT_EQ(std::memcmp(&unit, &u, sizeof u), 0);
    const TileFilm &expected = a.units.at(u.x0).second;
    EXPECT_EQ(std::memcmp(film.pixels.data(), expected.pixels.data(), film.pixels.size() * sizeof(PixelSums)),
              0);
    EXPECT_EQ(std::memcmp(film.first_hits.data(), expected.first_hits.data(),
                          film.first_hits.size() * sizeof(PixelFirstHit)),
              0);
  }
  EXPECT_EQ(b.counters.num_samples, a.counters.num_samples);
  EXPECT_EQ(b.counters.largest_sample, a.counters.largest_sample);
  for (const auto &scene : three.scenes) EXPECT_GT(scene->num_units, 0);
  EXPECT_EQ(three.committed->most_photon_passes(), 3u);
}

// Settings and schedule reach every device with its units.
TEST(SeveralDevices, ShareOutReyes)
{
  const FakeDevices one({0}), three({0, 3, 1});
  const auto a = one.make_frame(123, 77), b = three.make_frame(123, 77);
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.pipeline = GPURT_PIPELINE_REYES;
  desc.samples_per_pixel = 8;
  desc.tile_size = 16;
  desc.reyes.shading_rate = 2;
  desc.schedule.launch = GPURT_LAUNCH_ROUNDS;
  desc.schedule.traversal = GPURT_TRAVERSAL_UBER;
  for (const auto &frame : {a, b}) Job::submit(frame, desc, {})->wait(GPURT_WAIT_FOREVER);
  EXPECT_EQ(read_all(*a), read_all(*b));
  for (const auto &scene : three.scenes) {
    EXPECT_GT(scene->num_units, 0);
    EXPECT_EQ(scene->num_reyes_passes, int(scene->fake.num_passes));
  }
}

TEST(SeveralDevices, StopWhenCancelled)
{
  const FakeDevices two({20, 20});
  const auto frame = two.make_frame(512, 512);
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.samples_per_pixel = 1000;
  const auto job = Job::submit(frame, desc, {});
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  job->cancel();
  message_of([&] { job->wait(GPURT_WAIT_FOREVER); }, GPURT_ERROR_CANCELLED);
}

TEST(SeveralDevices, TraceDeviceMemoryWhereItIs)
{
  const FakeDevices two({0, 0});
  TraceRequest request;
  request.device_memory = true;
  request.num_rays = 5;
  request.rays = reinterpret_cast<const Ray *>(uintptr_t(2) << 32);
  two.committed->trace(request);
  EXPECT_EQ(two.scenes[0]->num_rays, 0u);
  EXPECT_EQ(two.scenes[1]->num_rays, 5u);
  request.rays = reinterpret_cast<const Ray *>(uintptr_t(9) << 32);
  EXPECT_TRUE(contains(message_of([&] { two.committed->trace(request); }, GPURT_ERROR_INVALID_ARGUMENT),
                       "rays lies in the memory of none of the devices 0 and 1"));
  EXPECT_TRUE(two.backend->holds(reinterpret_cast<void *>(uintptr_t(1) << 32)));
  EXPECT_FALSE(two.backend->holds(reinterpret_cast<void *>(uintptr_t(9) << 32)));
}

TEST(SeveralDevices, AddUpInWhatTheyAre)
{
  std::vector<std::unique_ptr<Backend>> members;
  std::vector<std::shared_ptr<MemoryTracker>> memory;
  for (uint32_t i : {0u, 2u}) {
    members.push_back(std::make_unique<FakeBackend>(i, nullptr, 100));
    memory.push_back(members.back()->memory());
  }
  const auto joined = multi::join(std::move(members));
  EXPECT_EQ(joined->info().num_threads, 2u);
  EXPECT_EQ(joined->info().memory_bytes, 2000u);
  EXPECT_EQ(joined->info().compute_capability, 88u);
  EXPECT_EQ(joined->info().ordinal, 0u);
  EXPECT_EQ(joined->info().name, "2 x Fake");
  EXPECT_EQ(joined->memory()->limit(), 200u);
  memory[0]->reserve(70, "a");
  memory[1]->reserve(80, "b");
  EXPECT_EQ(joined->memory()->used(), 150u);
  message_of([&] { memory[0]->reserve(40, "more than the device's own limit"); }, GPURT_ERROR_OUT_OF_MEMORY);
  message_of([&] { joined->memory()->reserve(60, "more than all"); }, GPURT_ERROR_OUT_OF_MEMORY);
  {
    const Reservation host(joined->memory(), 45, "a film");
    message_of([&] { memory[1]->reserve(10, "what the film has taken"); }, GPURT_ERROR_OUT_OF_MEMORY);
    EXPECT_EQ(memory[1]->used(), 80u);
  }
  memory[0]->release(70);
  memory[1]->release(80);
  EXPECT_EQ(joined->memory()->used(), 0u);
  EXPECT_EQ(joined->memory()->peak(), 195u);
}

// Two real ones, with threads of their own.
class TwoCpus : public testing::Test {
 protected:
  TwoCpus()
  {
    Random rng(3);
    maker_.add_world(soup(rng, 4000, 0.3f, 2));
    std::vector<std::unique_ptr<Backend>> members;
    for (uint32_t threads : {1u, 2u}) {
      BackendOptions options;
      options.num_threads = threads;
      members.push_back(cpu::factory().create(options));
    }
    two_ = multi::join(std::move(members));
    BuildOptions build;
    build.accel = Accel::KdTree;
    one_scene_ = backend().commit(maker_.scene(), build);
    two_scene_ = two_->commit(maker_.scene(), build);
    for (size_t i = 0; i < 700'001; ++i) {
      const Vec3f o = rng.point(3), d = rng.point(1);
      rays_.push_back({o, 0, d, infinity});
    }
  }

  SceneMaker maker_;
  std::unique_ptr<Backend> two_;
  std::shared_ptr<const CommittedScene> one_scene_, two_scene_;
  std::vector<Ray> rays_;
};

TEST_F(TwoCpus, FindTheHitsOfOne)
{
  std::vector<gpurt_hit> a(rays_.size()), b(rays_.size());
  std::vector<uint8_t> c(rays_.size()), d(rays_.size());
  TraceRequest request;
  request.num_rays = rays_.size();
  request.rays = rays_.data();
  request.hits = a.data();
  one_scene_->trace(request);
  request.hits = b.data();
  two_scene_->trace(request);
  EXPECT_EQ(std::memcmp(a.data(), b.data(), a.size() * sizeof(gpurt_hit)), 0);
  request.hits = nullptr;
  request.query = QueryKind::Any;
  request.occluded = c.data();
  one_scene_->trace(request);
  request.occluded = d.data();
  two_scene_->trace(request);
  EXPECT_EQ(c, d);
  EXPECT_GT(std::count(c.begin(), c.end(), 1), 1000);
}

TEST_F(TwoCpus, FindAllHitsOfOne)
{
  for (bool compact : {false, true}) {
    const uint64_t bytes = compact ? sizeof(gpurt_hit_compact) : sizeof(gpurt_hit);
    std::vector<uint64_t> a(rays_.size() + 1), b(rays_.size() + 1, 99);
    TraceRequest request;
    request.query = QueryKind::All;
    request.compact = compact;
    request.num_rays = rays_.size();
    request.rays = rays_.data();
    request.offsets = a.data();
    one_scene_->trace(request);
    request.offsets = b.data();
    two_scene_->trace(request);
    ASSERT_EQ(a, b);
    const uint64_t num_hits = a.back();
    ASSERT_GT(num_hits, rays_.size() / 10);
    std::vector<std::byte> c(num_hits * bytes), d(num_hits * bytes);
    request.hit_capacity = num_hits;
    request.hits = c.data();
    one_scene_->trace(request);
    request.hits = d.data();
    two_scene_->trace(request);
    EXPECT_EQ(a, b);
    EXPECT_EQ(std::memcmp(c.data(), d.data(), c.size()), 0);
    request.hit_capacity = num_hits - 1;
    EXPECT_TRUE(contains(message_of([&] { two_scene_->trace(request); }, GPURT_ERROR_INVALID_ARGUMENT),
                         std::to_string(num_hits) + " hits"));
    EXPECT_EQ(a, b) << "offsets tell how large";
  }
}

// Patches, one of which blends, a mesh and a light: by REYES, with light of samples and of micropolygons.
TEST_F(TwoCpus, RenderReyesToTheBitsOfOne)
{
  SceneData data;
  MaterialSettings pane;
  pane.alpha = 0.5f;
  pane.blends = true;
  const uint32_t panes = add_material(data, pane);
  const auto add_bowl = [&](uint32_t material, float z) {
    std::vector<Vec3f> points;
    for (int k = 0; k < 16; ++k) {
      const float x = float(k % 4) / 1.5f - 1, y = float(k / 4) / 1.5f - 1;
      points.push_back({x, y, z + 0.5f * (x * x + y * y)});
    }
    GeometryData geometry;
    geometry.kind = GeometryKind::Patches;
    geometry.material = material;
    geometry.patches.control_points = SharedArray<Vec3f>(std::move(points));
    data.geometries.push_back(std::move(geometry));
  };
  add_bowl(0, 0);
  add_bowl(panes, 0.4f);
  GeometryData floor;
  floor.mesh.vertices = SharedArray<Vec3f>({{-9, -9, -1}, {9, -9, -1}, {0, 9, -1}});
  floor.mesh.indices = SharedArray<UInt3>({{0, 1, 2}});
  data.geometries.push_back(std::move(floor));
  const Transform identity{{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
  for (uint32_t i = 0; i < 3; ++i)
    data.instances.push_back({i, identity, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}});
  data.lights.push_back({LightType::Point, {9, 9, 9}, {2, 2, 4}, {0, 0, -1}, 0, 0});
  data.cameras.push_back({{{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 4}}}, 0.6f, 0, 0});
  const auto with_panes = std::make_shared<CompiledScene>(compile_scene(data, 0));
  data.instances.erase(data.instances.begin() + 1);
  const auto opaque = std::make_shared<CompiledScene>(compile_scene(data, 0));
  BuildOptions build;
  build.accel = Accel::Bvh;
  for (const auto shading : {GPURT_REYES_SHADING_SAMPLES, GPURT_REYES_SHADING_MICROPOLYGONS}) {
    const auto &compiled = shading == GPURT_REYES_SHADING_SAMPLES ? with_panes : opaque;
    std::vector<std::vector<std::vector<uint32_t>>> images;
    std::vector<uint64_t> num_fragments;
    for (Backend *device : {static_cast<Backend *>(&backend()), two_.get()}) {
      gpurt_frame_desc desc = GPURT_FRAME_DESC_INIT;
      desc.width = desc.height = 90;
      desc.outputs = 1u << GPURT_OUTPUT_COLOR | 1u << GPURT_OUTPUT_ALPHA;
      const auto frame =
          std::make_shared<Frame>(FrameScene{device->commit(compiled, build), compiled, device->memory(),
                                             device->info().num_threads, 0.0},
                                  desc);
      gpurt_render_desc render = GPURT_RENDER_DESC_INIT;
      render.pipeline = GPURT_PIPELINE_REYES;
      render.samples_per_pixel = 9;
      render.tile_size = 64;
      render.reyes.shading = shading;
      Job::submit(frame, render, {})->wait(GPURT_WAIT_FOREVER);
      images.push_back(read_all(*frame));
      num_fragments.push_back(statistics(*frame).reyes_counters.num_fragments);
      const auto color = read<float>(*frame, GPURT_OUTPUT_COLOR);
      EXPECT_GT(std::accumulate(color.begin(), color.end(), 0.0), 90 * 90 * 0.05);
    }
    EXPECT_EQ(images[0], images[1]);
    EXPECT_EQ(num_fragments[0], num_fragments[1]);
  }
}

TEST_F(TwoCpus, HaveOneTreeAndTheMemoryOfTwo)
{
  EXPECT_EQ(two_scene_->accel_facts().num_nodes, one_scene_->accel_facts().num_nodes);
  EXPECT_EQ(two_scene_->accel_facts().accel_bytes, 2 * one_scene_->accel_facts().accel_bytes);
  EXPECT_EQ(two_scene_->export_tree(0).references, one_scene_->export_tree(0).references);
  EXPECT_GE(two_->memory()->used(), two_scene_->accel_facts().accel_bytes);
}

}  // namespace
}  // namespace gpurt_test
