// gpurt verify: do two independent accelerators see the same scene?
#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>

#include "options.h"
#include "progress.h"
#include "rays.h"

namespace cli {

namespace {

struct VerifyOptions {
  std::string scene;
  uint64_t num_random = 1'000'000;
  uint32_t width = 0, height = 0, camera = 0;
  uint64_t seed = 1;
  std::string triangle_test = "watertight";
  DeviceOptions device;
};

std::vector<gpurt_hit> closest(gpurt_scene scene, const std::vector<gpurt_ray> &rays)
{
  std::vector<gpurt_hit> hits(rays.size());
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.num_rays = rays.size();
  desc.rays = rays.data();
  desc.hits = hits.data();
  check(gpurt_scene_trace(scene, &desc));
  return hits;
}

std::vector<uint8_t> occluded(gpurt_scene scene, const std::vector<gpurt_ray> &rays)
{
  std::vector<uint8_t> hits(rays.size());
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.query = GPURT_QUERY_ANY;
  desc.num_rays = rays.size();
  desc.rays = rays.data();
  desc.occluded = hits.data();
  check(gpurt_scene_trace(scene, &desc));
  return hits;
}

bool is_hit(const gpurt_hit &hit) { return hit.primitive != GPURT_INVALID_ID; }
bool same_primitive(const gpurt_hit &a, const gpurt_hit &b)
{
  return a.primitive == b.primitive && a.geometry == b.geometry && a.instance == b.instance;
}

// Floats between two positive ones.
uint64_t ulps_between(float a, float b)
{
  int32_t x, y;
  std::memcpy(&x, &a, 4);
  std::memcpy(&y, &b, 4);
  return uint64_t(std::abs(int64_t(x) - y));
}

// How two answers to one ray relate.
enum Class { SameMiss, SameHit, OtherPrimitive, SameWithin, Different, HitAgainstMiss, NumClasses };
constexpr const char *class_names[NumClasses] = {
    "both miss",
    "same triangle, t within 8 ulp",
    "neighbouring triangle, t within 8 ulp",
    "equal within a turn of the ray by 2^-20",
    "different t",
    "hit against miss",
};

constexpr uint64_t ulp_bound = 8;
constexpr int num_turns = 16;
constexpr float turn =
    0x1p-20f;  // a few roundings of origin and direction: what single precision may do to any ray

// What an accelerator answers when the ray is turned and moved a little: an interval of t, and whether it may miss.
struct Nearby {
  float t_min = std::numeric_limits<float>::infinity(), t_max = 0;
  bool may_hit = false, may_miss = false;
  void add(const gpurt_hit &hit)
  {
    if (is_hit(hit)) {
      may_hit = true;
      t_min = std::min(t_min, hit.t);
      t_max = std::max(t_max, hit.t);
    } else {
      may_miss = true;
    }
  }
  bool explains(const gpurt_hit &hit) const
  {
    return is_hit(hit) ? may_hit && hit.t >= t_min && hit.t <= t_max : may_miss;
  }
};

std::vector<gpurt_ray> turned_rays(const std::vector<gpurt_ray> &rays, const std::vector<size_t> &which,
                                   Random &random)
{
  std::vector<gpurt_ray> turned;
  turned.reserve(which.size() * num_turns);
  for (size_t i : which) {
    const gpurt_ray &ray = rays[i];
    float size = 0;
    for (float x : ray.origin) size = std::max(size, std::abs(x));
    for (int k = 0; k < num_turns; ++k) {
      gpurt_ray r = ray;
      const Vec d = sphere_direction(random) * turn, o = sphere_direction(random) * (turn * size);
      const float *dd = &d.x, *oo = &o.x;
      for (int c = 0; c < 3; ++c) {
        r.direction[c] += dd[c];
        r.origin[c] += oo[c];
      }
      turned.push_back(r);
    }
  }
  return turned;
}

class Verifier {
 public:
  Verifier(gpurt_scene kdtree, gpurt_scene embree, uint64_t seed)
      : kdtree_(kdtree), embree_(embree), random_(seed)
  {}

  /// Adds a column to the table.
  void compare(const char *name, const std::vector<gpurt_ray> &rays)
  {
    std::vector<uint64_t> counts(NumClasses);
    const std::vector<gpurt_hit> a = closest(kdtree_, rays), b = closest(embree_, rays);
    std::vector<size_t> unclear;
    for (size_t i = 0; i < rays.size(); ++i) {
      if (!is_hit(a[i]) && !is_hit(b[i])) counts[SameMiss]++;
      else if (!is_hit(a[i]) || !is_hit(b[i]) || ulps_between(a[i].t, b[i].t) > ulp_bound)
        unclear.push_back(i);
      else counts[same_primitive(a[i], b[i]) ? SameHit : OtherPrimitive]++;
    }
    // A ray along an edge or nearly in a plane has no answer to the last bit: there both must hold for rays nearby.
    const std::vector<gpurt_ray> turned = turned_rays(rays, unclear, random_);
    const std::vector<gpurt_hit> near_a = closest(kdtree_, turned), near_b = closest(embree_, turned);
    for (size_t k = 0; k < unclear.size(); ++k) {
      const size_t i = unclear[k];
      Nearby nearby;
      nearby.add(a[i]);
      for (int j = 0; j < num_turns; ++j) nearby.add(near_a[k * num_turns + size_t(j)]);
      Nearby other;
      other.add(b[i]);
      for (int j = 0; j < num_turns; ++j) other.add(near_b[k * num_turns + size_t(j)]);
      if (nearby.explains(b[i]) || other.explains(a[i])) {
        counts[SameWithin]++;
        continue;
      }
      const Class what = is_hit(a[i]) != is_hit(b[i]) ? HitAgainstMiss : Different;
      counts[what]++;
      if (examples_.size() < 5) examples_.push_back(describe(name, i, rays[i], a[i], b[i]));
    }
    // An any-hit query must say what the closest-hit query says.
    const std::vector<uint8_t> any_a = occluded(kdtree_, rays), any_b = occluded(embree_, rays);
    for (size_t i = 0; i < rays.size(); ++i)
      num_any_differ_ += (any_a[i] != 0) != is_hit(a[i]) || (any_b[i] != 0) != is_hit(b[i]);
    columns_.push_back({name, counts, rays.size()});
    num_bad_ += counts[Different] + counts[HitAgainstMiss];
  }

  bool is_sound() const { return num_bad_ == 0 && num_any_differ_ == 0; }
  uint64_t num_bad() const { return num_bad_ + num_any_differ_; }

  void print() const
  {
    fmt::print("{:<42}", "rays");
    for (const Column &column : columns_) fmt::print("{:>14}", column.name);
    fmt::print("\n{:<42}", "");
    for (const Column &column : columns_) fmt::print("{:>14}", column.num_rays);
    fmt::print("\n");
    for (int what = 0; what < NumClasses; ++what) {
      fmt::print("{:<42}", class_names[what]);
      for (const Column &column : columns_) fmt::print("{:>14}", column.counts[size_t(what)]);
      fmt::print("\n");
    }
    fmt::print("{:<42}{:>14}\n", "any-hit query contradicts closest hit", num_any_differ_);
    for (const std::string &example : examples_) fmt::print("{}\n", example);
  }

 private:
  struct Column {
    const char *name;
    std::vector<uint64_t> counts;
    uint64_t num_rays;
  };

  static std::string describe(const char *name, size_t i, const gpurt_ray &ray, const gpurt_hit &a,
                              const gpurt_hit &b)
  {
    const auto text = [](const gpurt_hit &hit) {
      return is_hit(hit)
                 ? fmt::format("t {:.9g} at triangle {} of instance {}", hit.t, hit.primitive, hit.instance)
                 : std::string("miss");
    };
    return fmt::format(
        "{} ray {}: o ({:.9g}, {:.9g}, {:.9g}) d ({:.9g}, {:.9g}, {:.9g}): kdtree {}, embree {}", name, i,
        ray.origin[0], ray.origin[1], ray.origin[2], ray.direction[0], ray.direction[1], ray.direction[2],
        text(a), text(b));
  }

  gpurt_scene kdtree_, embree_;
  Random random_;
  std::vector<Column> columns_;
  std::vector<std::string> examples_;
  uint64_t num_bad_ = 0, num_any_differ_ = 0;
};

void run(const VerifyOptions &o)
{
  const Device device = o.device.create(GPURT_DEVICE_CPU);
  BuildOptions kdtree_build, embree_build;
  kdtree_build.accel = "kdtree";
  kdtree_build.triangle_test = o.triangle_test;
  embree_build.accel = "embree";
  const Scene kdtree = load_scene(device, o.scene), embree = load_scene(device, o.scene);
  commit(kdtree, kdtree_build);
  commit(embree, embree_build);
  add_default_camera(kdtree, kdtree_build);
  const gpurt_scene_facts facts = facts_of(kdtree);
  if (!(facts.bounds_min[0] <= facts.bounds_max[0])) fail("{}: has no geometry to verify", o.scene);
  gpurt_camera_desc camera = GPURT_CAMERA_DESC_INIT;
  check(gpurt_scene_get_camera(kdtree, o.camera, &camera));
  const uint32_t width = o.width ? o.width : camera.width ? camera.width : 512;
  const uint32_t height = o.height ? o.height : camera.height ? camera.height : 512;

  Verifier verifier(kdtree, embree, o.seed);
  verifier.compare("camera", camera_rays(camera, width, height));
  Random random(o.seed);
  verifier.compare("random", random_rays(facts, o.num_random, random));
  if (!o.device.quiet) verifier.print();
  if (!verifier.is_sound()) fail("{}: kdtree and embree disagree on {} rays", o.scene, verifier.num_bad());
  if (!o.device.quiet) fmt::print("kdtree and embree agree\n");
}

}  // namespace

void add_verify_command(CLI::App &program)
{
  auto o = std::make_shared<VerifyOptions>();
  CLI::App *command = program.add_subcommand("verify", "Check the kd-tree against Embree, ray by ray");
  command->footer(R"(
Traces the camera's rays and random ones through both accelerators. A ray passes if both miss, if t agrees within
8 ulp, or if the one answer lies among those that the other gives when the ray is turned by 2^-20: along edges and
nearly in planes single precision has no better answer. Everything else is a leak or a wrong hit: exit status 1.

Example:
  gpurt verify city.glb --rays 10000000
)");
  command->add_option("scene", o->scene, "glTF 2.0 file")->required()->type_name("SCENE");
  command->add_option("--rays", o->num_random, "number of random rays")
      ->check(CLI::Range(uint64_t(1), uint64_t(1) << 28))
      ->capture_default_str();
  command->add_option("--width", o->width, "of the camera's image")->check(CLI::Range(1, 16384));
  command->add_option("--height", o->height)->check(CLI::Range(1, 16384));
  command->add_option("--camera", o->camera, "which camera of the scene, counted from 0")
      ->capture_default_str();
  command->add_option("--seed", o->seed, "of the random rays")->capture_default_str();
  command
      ->add_option("--triangle-test", o->triangle_test,
                   "of the kd-tree: watertight, moller-trumbore or double")
      ->check(CLI::IsMember({"watertight", "moller-trumbore", "double"}))
      ->capture_default_str();
  o->device.add_to(*command);
  command->callback([o] { run(*o); });
}

}  // namespace cli
