#include "scene/light_tree.h"

#include <tbb/parallel_invoke.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <span>

#include "scene/cone.h"
#include "scene/parallel.h"
#include "scene/rounding.h"
#include "scene/trigonometry.h"

namespace gpurt {
namespace {

constexpr int max_depth = 64;  // Light::tree_path has a bit a level
constexpr int num_bins = 12;
constexpr size_t parallel_lights = 2048;

// What a set of lights needs to bound its contribution.
struct LightBounds {
  Box box = empty_box();
  Cone normals;
  double cos_emit = 1;  // of the angle around a normal beyond which nothing is emitted
  double power = 0;
  bool two_sided = false;
};

LightBounds join(LightBounds a, const LightBounds &b)
{
  // What never shines widens nothing.
  if (b.power <= 0) return a;
  if (a.power <= 0) return b;
  a.box = extend(a.box, b.box);
  // Seen from both sides, a normal and its opposite are the same.
  Cone other = b.normals;
  if (a.two_sided && b.two_sided && dot(a.normals.axis, other.axis) < 0) other.axis = other.axis * -1;
  a.normals = join(a.normals, other);
  a.cos_emit = std::min(a.cos_emit, b.cos_emit);
  a.power += b.power;
  a.two_sided = a.two_sided || b.two_sided;
  return a;
}

struct Item {
  LightBounds bounds;
  Vec3f center;
  uint32_t light;
};

double intensity_power(Vec3f color)
{
  return 4 * pi_double * (0.2126 * color.x + 0.7152 * color.y + 0.0722 * color.z);
}

Vec3d world_corner(const CompiledScene &scene, const Light &light, uint32_t vertex)
{
  const Vec3d p = to_double(scene.positions[vertex]);
  if (light.placement == invalid_id) return p;
  return transform_point(to_double(scene.placements[light.placement].object_to_world), p);
}

// The renderer rounds transformed corners to float; the box reaches two floats further.
Box box_of(const Vec3d (&corners)[3], bool exact)
{
  Box box = empty_box();
  for (const Vec3d &p : corners) {
    const Vec3f lo{round_down(p.x), round_down(p.y), round_down(p.z)},
        hi{round_up(p.x), round_up(p.y), round_up(p.z)};
    box = extend(extend(box, lo), hi);
  }
  if (exact) return box;
  const Vec3f margin = max(abs(box.lo), abs(box.hi)) * (4 * float_epsilon);
  return {box.lo - margin, box.hi + margin};
}

LightBounds bounds_of(const CompiledScene &scene, const Light &light)
{
  LightBounds b;
  if (light.type == LightType::Triangle) {
    const UInt3 corner = scene.indices[light.triangle];
    const Vec3d corners[3] = {world_corner(scene, light, corner.x), world_corner(scene, light, corner.y),
                              world_corner(scene, light, corner.z)};
    const Vec3d normal = cross(corners[1] - corners[0], corners[2] - corners[0]);
    const bool is_mirrored = light.placement != invalid_id && scene.placements[light.placement].flips != 0;
    b.box = box_of(corners, light.placement == invalid_id);
    b.power = intensity_power(light.color) * 0.5 * length(normal);
    if (!is_zero(normal)) b.normals = {normalize(is_mirrored ? normal * -1 : normal), 1};
    b.cos_emit = 0;
    b.two_sided = light.two_sided != 0;
    return b;
  }
  b.box = {light.position, light.position};
  b.power = intensity_power(light.color);
  if (light.type == LightType::Spot) {
    b.normals = {to_double(light.direction), 1};
    b.cos_emit = light.cos_outer;
  } else {
    b.normals = {{0, 0, 1}, -1};
    b.cos_emit = 0;
  }
  return b;
}

// Solid-angle measure of the directions into which a cone of normals emits.
// Source: Conty Estevez and Kulla 2018, Section 4.3.
double orientation_measure(const LightBounds &b)
{
  const Angle o = angle_from_cos(b.normals.cos_angle);
  const double theta_o = approximate_acos(o.cos);
  const double theta_w = std::min(theta_o + approximate_acos(b.cos_emit), pi_double);
  // cos(theta_o - 2 theta_w), by the exact cosine and sine of theta_w where it is not clipped to pi.
  const Angle w = theta_w < pi_double ? o + angle_from_cos(b.cos_emit) : Angle{-1, 0};
  const double cos_last = (o - (w + w)).cos;
  return 2 * pi_double * (1 - o.cos) +
         0.5 * pi_double * (2 * theta_w * o.sin - cos_last - 2 * theta_o * o.sin + o.cos);
}

// Surface area measure. Differs: a share of the squared diagonal is added, so that points along a line count.
double area_measure(const Box &box)
{
  const Vec3d d = to_double(box.hi) - to_double(box.lo);
  return 2 * (d.x * d.y + d.y * d.z + d.z * d.x) + 0x1p-6 * dot(d, d);
}

double cost(const LightBounds &b)
{
  return b.power <= 0 ? 0 : b.power * area_measure(b.box) * orientation_measure(b);
}

struct Split {
  int axis = -1;
  int bin = 0;  // lights of bins <= bin go to the first child
  double cost = 0;
};

struct Binning {
  double lo, scale;
  Binning(const Box &centers, int axis)
      : lo(at(centers.lo, axis)), scale(num_bins / (double(at(centers.hi, axis)) - at(centers.lo, axis)))
  {}
  int bin(float x) const { return std::min(int((x - lo) * scale), num_bins - 1); }
};

// The lights of a bin, bounded well enough to weigh a split: the cone is around the mean normal, which takes no more
// than a dot product a light. The bounds of nodes are made with care, once the tree is there.
struct Bin {
  LightBounds bounds;
  Vec3d axis_sum{0, 0, 0};
  double min_cos = 1;
  bool has_all_directions = false;
  size_t count = 0;
};

// An item's axis, on the side of `reference` if it shines to both.
Vec3d facing(const Item &item, Vec3d reference)
{
  const Vec3d axis = item.bounds.normals.axis;
  return item.bounds.two_sided && dot(axis, reference) < 0 ? axis * -1 : axis;
}

void fill_bins(std::span<const Item> items, const Binning &binning, int axis, Bin (&bins)[num_bins])
{
  for (const Item &item : items) {
    Bin &bin = bins[binning.bin(at(item.center, axis))];
    bin.count++;
    if (item.bounds.power <= 0) continue;
    LightBounds &b = bin.bounds;
    b.box = extend(b.box, item.bounds.box);
    b.cos_emit = std::min(b.cos_emit, item.bounds.cos_emit);
    b.power += item.bounds.power;
    b.two_sided = b.two_sided || item.bounds.two_sided;
    if (item.bounds.normals.cos_angle < 1) bin.has_all_directions = true;
    else bin.axis_sum = bin.axis_sum + facing(item, bin.axis_sum);
  }
  for (Bin &bin : bins) {
    bin.bounds.normals.cos_angle = bin.has_all_directions || is_zero(bin.axis_sum) ? -1 : 1;
    if (!is_zero(bin.axis_sum)) bin.bounds.normals.axis = normalize(bin.axis_sum);
  }
  for (const Item &item : items) {
    Bin &bin = bins[binning.bin(at(item.center, axis))];
    if (item.bounds.power <= 0) continue;
    const Vec3d mean = bin.bounds.normals.axis;
    bin.min_cos = std::min(bin.min_cos, dot(facing(item, mean), mean));
  }
  for (Bin &bin : bins) bin.bounds.normals.cos_angle = std::min(bin.bounds.normals.cos_angle, bin.min_cos);
}

// Surface area orientation heuristic over bins of one axis.
// Source: Conty Estevez and Kulla 2018, Section 4.4, Eq. 2.
Split best_split(std::span<const Item> items, const Box &centers, int axis)
{
  const double extent = double(at(centers.hi, axis)) - at(centers.lo, axis);
  if (!(extent > 0) || !std::isfinite(num_bins / extent)) return {};
  Bin bins[num_bins];
  fill_bins(items, Binning(centers, axis), axis, bins);
  double cost_above[num_bins] = {};  // of bins > i
  size_t count_above[num_bins] = {};
  LightBounds above;
  size_t count = 0;
  for (int i = num_bins - 2; i >= 0; --i) {
    count += bins[i + 1].count;
    count_above[i] = count;
    cost_above[i] = cost_above[i + 1];
    if (bins[i + 1].bounds.power <= 0) continue;
    above = join(above, bins[i + 1].bounds);
    cost_above[i] = cost(above);
  }
  // Long boxes are rather cut across.
  const Vec3d d = to_double(centers.hi) - to_double(centers.lo);
  const double regularization = max_component_abs(d) / extent;
  Split best;
  LightBounds below;
  for (int i = 0; i < num_bins - 1; ++i) {
    if (bins[i].count == 0) continue;  // the same split as before
    below = join(below, bins[i].bounds);
    if (count_above[i] == 0 || count_above[i] == items.size()) continue;
    const double c = regularization * (cost(below) + cost_above[i]);
    if (best.axis < 0 || c < best.cost) best = {axis, i, c};
  }
  return best;
}

class Builder {
 public:
  Builder(CompiledScene &scene) : scene_(scene), items_(scene.num_tree_lights)
  {
    parallel_for_each(items_.size(), [&](uint64_t i) {
      const LightBounds b = bounds_of(scene, scene.lights[i]);
      items_[i] = {b, b.box.lo * 0.5f + b.box.hi * 0.5f, uint32_t(i)};
    });
  }

  void run()
  {
    if (items_.empty()) return;
    scene_.light_nodes.resize(2 * items_.size() - 1);
    build(items_, 0, 1, 0, 0);
  }

 private:
  // Writes node `index`; its descendants are the 2 n - 2 nodes from `first_free` on. So every subtree knows its place
  // and the layout does not depend on who builds it when.
  LightBounds build(std::span<Item> items, uint32_t index, uint32_t first_free, uint64_t path, int depth)
  {
    if (items.size() == 1) {
      scene_.lights[items[0].light].tree_path = path;
      write(index, items[0].bounds, items[0].light, true);
      return items[0].bounds;
    }
    const size_t middle = partition(items, depth);
    const auto first = items.first(middle), second = items.subspan(middle);
    const uint32_t free_first = first_free + 2, free_second = free_first + uint32_t(2 * (middle - 1));
    LightBounds a, b;
    const auto build_first = [&] { a = build(first, first_free, free_first, path, depth + 1); };
    const auto build_second = [&] {
      b = build(second, first_free + 1, free_second, path | uint64_t(1) << depth, depth + 1);
    };
    if (items.size() >= parallel_lights) {
      tbb::parallel_invoke(build_first, build_second);
    } else {
      build_first();
      build_second();
    }
    const LightBounds bounds = join(a, b);
    write(index, bounds, first_free, false);
    return bounds;
  }

  // Reorders items and returns how many go to the first child.
  static size_t partition(std::span<Item> items, int depth)
  {
    Box centers = empty_box();
    for (const Item &item : items) centers = extend(centers, item.center);
    // A tree of n leaves can always be made bit_width(n - 1) levels deep; keep that many in reserve for either child.
    const auto fits = [&](size_t n) { return int(std::bit_width(n - 1)) <= max_depth - (depth + 1); };
    if (items.size() > 2) {
      Split splits[3];
      if (items.size() >= parallel_lights) {
        tbb::parallel_for(0, 3, [&](int axis) { splits[axis] = best_split(items, centers, axis); });
      } else {
        for (int axis = 0; axis < 3; ++axis) splits[axis] = best_split(items, centers, axis);
      }
      Split best;
      for (const Split &s : splits) {
        if (s.axis >= 0 && (best.axis < 0 || s.cost < best.cost)) best = s;
      }
      if (best.axis >= 0) {
        const Binning binning(centers, best.axis);
        const auto is_first = [&](const Item &item) {
          return binning.bin(at(item.center, best.axis)) <= best.bin;
        };
        const size_t middle = size_t(std::partition(items.begin(), items.end(), is_first) - items.begin());
        if (fits(middle) && fits(items.size() - middle)) return middle;
      }
    }
    // Coincident lights, or no depth left: halve them along the longest axis, equal ones by their order.
    const Vec3f d = centers.hi - centers.lo;
    const int axis = d.x >= d.y && d.x >= d.z ? 0 : (d.y >= d.z ? 1 : 2);
    const size_t middle = items.size() / 2;
    std::nth_element(items.begin(), items.begin() + middle, items.end(),
                     [axis](const Item &a, const Item &b) {
                       const float x = at(a.center, axis), y = at(b.center, axis);
                       return x < y || (x == y && a.light < b.light);
                     });
    return middle;
  }

  void write(uint32_t index, const LightBounds &b, uint32_t child, bool is_leaf)
  {
    LightNode &node = scene_.light_nodes[index];
    node.bounds = b.box;
    node.axis = to_float(b.normals.axis);
    // Rounded outward: rounding must not exclude a direction.
    node.cos_theta =
        b.normals.cos_angle >= 1 ? 1.0f : std::max(round_down(b.normals.cos_angle - 0x1p-23), -1.0f);
    node.cos_emit = round_down(b.cos_emit);
    constexpr double least = std::numeric_limits<float>::min(), most = std::numeric_limits<float>::max();
    node.power = b.power > 0 ? float(std::clamp(b.power, least, most)) : 0.0f;
    node.child = child;
    node.is_leaf = is_leaf ? 1 : 0;
    node.two_sided = b.two_sided ? 1 : 0;
    node.reserved = 0;
  }

  CompiledScene &scene_;
  std::vector<Item> items_;
};

// Slot k of a bundle is the child k & 1 of the child k >> 1; a child that is a leaf is its own first child.
class Bundler {
 public:
  explicit Bundler(CompiledScene &scene) : nodes_(scene.light_nodes), bundles_(scene.light_bundles) {}

  void run()
  {
    bundles_.clear();
    if (nodes_.empty()) return;
    bundles_.emplace_back();
    put(0, 0, 0);
    // Bundles are made breadth first: `sources_` has the node that bundle i + 1 is of.
    for (size_t i = 0; i < sources_.size(); ++i) {
      const uint32_t first = nodes_[sources_[i]].child, bundle = uint32_t(i) + 1;
      for (uint32_t side = 0; side < 2; ++side) {
        const LightNode &child = nodes_[first + side];
        if (child.is_leaf) {
          put(bundle, 2 * side, first + side);
        } else {
          put(bundle, 2 * side, child.child);
          put(bundle, 2 * side + 1, child.child + 1);
        }
      }
    }
  }

 private:
  void put(uint32_t bundle, uint32_t k, uint32_t index)
  {
    const LightNode &node = nodes_[index];
    uint32_t child = node.child | light_leaf_bit;
    if (!node.is_leaf) {
      sources_.push_back(index);
      child = uint32_t(sources_.size());
      bundles_.emplace_back();
    }
    LightBundle &b = bundles_[bundle];
    b.child[k] = child;
    b.power[k] = node.power;
    if (node.power <= 0) return;
    double radius2 = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const double lo = at(node.bounds.lo, axis), hi = at(node.bounds.hi, axis);
      const float center = float((lo + hi) / 2);
      const double reach = std::max(hi - center, center - lo);
      radius2 += reach * reach;
      b.center[axis][k] = center;
      b.axis[axis][k] = at(node.axis, axis);
    }
    b.radius[k] = float(std::sqrt(radius2));
    b.cos_theta[k] = node.cos_theta;
    b.sin_theta[k] = float(std::sqrt(1 - double(node.cos_theta) * node.cos_theta));
    b.cos_emit[k] = node.cos_emit;
    b.facing[k] = node.two_sided ? -1.0f : 1.0f;
  }

  const std::vector<LightNode> &nodes_;
  std::vector<LightBundle> &bundles_;
  std::vector<uint32_t> sources_;
};

}  // namespace

void build_light_tree(CompiledScene &scene)
{
  scene.light_nodes.clear();
  Builder(scene).run();
  Bundler(scene).run();
}

}  // namespace gpurt
