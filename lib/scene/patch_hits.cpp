#include "scene/patch_hits.h"

#include <cmath>
#include <cstring>
#include <span>

#include "error.h"
#include "scene/parallel.h"
#include "scene/patches.h"

namespace gpurt {
namespace {

// Weights of a hit are of single precision; they may leave [0, 1], and their sum may, by what they were rounded by.
constexpr float weight_rounding = 0x1p-16f;

struct Located {
  const char *error = nullptr;  // why it lies on no patch
  gpurt_patch_point point{GPURT_INVALID_ID, 0, 0};
  uint32_t segment = invalid_id;
};

class Locator {
 public:
  Locator(const CompiledScene &scene, const LocateRequest &request) : scene_(scene), request_(request)
  {
    // What a geometry is stored as, and what an instance places: the last one is for ids that are not there.
    uint32_t num_geometries = 0;
    for (const Segment &s : scene.segments) num_geometries = std::max(num_geometries, s.geometry + 1);
    segment_of_.resize(size_t(num_geometries) + 1, invalid_id);
    for (size_t i = 0; i < scene.segments.size(); ++i) segment_of_[scene.segments[i].geometry] = uint32_t(i);
    if (!wants_surface()) return;
    uint32_t num_instances = 0;
    for (const Placement &p : scene.placements) num_instances = std::max(num_instances, p.instance + 1);
    placement_of_.resize(size_t(num_instances) + 1, invalid_id);
    for (size_t i = 0; i < scene.placements.size(); ++i)
      placement_of_[scene.placements[i].instance] = uint32_t(i);
  }

  void run() const
  {
    const uint64_t bad =
        find_first(request_.num_hits, [&](uint64_t i) { return locate(hit(i)).error != nullptr; });
    if (bad != request_.num_hits) refuse(bad);
    parallel_for_each(request_.num_hits, [&](uint64_t i) {
      const gpurt_hit h = hit(i);
      const Located at = locate(h);
      request_.points[i] = at.point;
      if (wants_surface()) store_surface(i, h, at);
    });
  }

 private:
  bool wants_surface() const { return request_.positions || request_.normals; }

  gpurt_hit hit(uint64_t i) const
  {
    gpurt_hit h{};
    if (!request_.compact) {
      std::memcpy(&h, static_cast<const gpurt_hit *>(request_.hits) + i, sizeof h);
      return h;
    }
    gpurt_hit_compact c;
    std::memcpy(&c, static_cast<const gpurt_hit_compact *>(request_.hits) + i, sizeof c);
    return {c.t, c.u, c.v, c.primitive, request_.geometry, request_.instance, {0, 0}};
  }

  uint32_t segment_of(uint32_t geometry) const
  {
    return segment_of_[std::min(size_t(geometry), segment_of_.size() - 1)];
  }
  uint32_t placement_of(uint32_t instance) const
  {
    return placement_of_[std::min(size_t(instance), placement_of_.size() - 1)];
  }

  bool is_placed_by(uint32_t segment, uint32_t instance) const
  {
    const Segment &s = scene_.segments[segment];
    if (s.instance != invalid_id) return s.instance == instance;
    const uint32_t placement = placement_of(instance);
    return placement != invalid_id && scene_.group_geometry[scene_.placements[placement].group] == s.geometry;
  }

  Located locate(const gpurt_hit &h) const
  {
    Located at;
    if (h.primitive == GPURT_INVALID_ID) return at;
    const uint32_t segment = segment_of(h.geometry);
    if (segment == invalid_id) return {"of geometry {1}, which the last commit does not have"};
    const Segment &s = scene_.segments[segment];
    const PatchRange range = scene_.patch_ranges[segment];
    if (range.num_patches == 0)
      return {
          "on geometry {1}, which has no patches; leave hits on meshes out, or make their primitive "
          "GPURT_INVALID_ID"};
    if (h.primitive >= s.num_triangles)
      return {"of primitive {2}, but geometry {1} has {3} triangles; hand in hits of the last commit"};
    if (!(h.u >= -weight_rounding && h.v >= -weight_rounding && h.u + h.v <= 1 + weight_rounding))
      return {"at u {4}, v {5}, which is no point of a triangle"};
    if (wants_surface() && !is_placed_by(segment, h.instance))
      return {"of instance {6}, which does not place geometry {1}"};

    const std::span<const PatchCells> cells(scene_.patch_cells.data() + range.first_patch, range.num_patches);
    at.point.patch = uint32_t(patch_of_triangle(cells, h.primitive));
    at.segment = segment;
    const UInt3 corner = scene_.indices[s.first_triangle + h.primitive];
    const auto uv = [&](uint32_t vertex) { return scene_.uvs[s.first_uv + (vertex - s.first_vertex)]; };
    const Vec2f a = uv(corner.x), b = uv(corner.y), c = uv(corner.z);
    const auto mix = [&](float p, float q, float r) {
      const double x =
          (1.0 - double(h.u) - double(h.v)) * double(p) + double(h.u) * double(q) + double(h.v) * double(r);
      return float(std::min(std::max(x, 0.0), 1.0));
    };
    at.point.u = mix(a.x, b.x, c.x);
    at.point.v = mix(a.y, b.y, c.y);
    return at;
  }

  [[noreturn]] void refuse(uint64_t i) const
  {
    const gpurt_hit h = hit(i);
    const uint32_t segment = segment_of(h.geometry);
    const uint32_t num_triangles = segment == invalid_id ? 0 : scene_.segments[segment].num_triangles;
    const std::string text = std::string("hit {0} is ") + locate(h).error;
    throw Error(GPURT_ERROR_INVALID_ARGUMENT, fmt::format(fmt::runtime(text), i, h.geometry, h.primitive,
                                                          num_triangles, h.u, h.v, h.instance));
  }

  // The patch's own, in the world.
  void store_surface(uint64_t i, const gpurt_hit &h, const Located &at) const
  {
    Vec3d p{0, 0, 0}, n{0, 0, 0};
    if (at.segment != invalid_id) {
      const Segment &s = scene_.segments[at.segment];
      const uint64_t patch = uint64_t(scene_.patch_ranges[at.segment].first_patch) + at.point.patch;
      const Vec3f *points = scene_.control_points.data() + 16 * patch;
      const double u = double(at.point.u), v = double(at.point.v);
      p = position_on_patch(points, u, v);
      n = normal_on_patch(points, u, v);
      if (s.instance == invalid_id) {
        const Placement &placement = scene_.placements[placement_of(h.instance)];
        p = transform_point(to_double(placement.object_to_world), p);
        n = normalize(transform_normal(to_double(placement.world_to_object), n));
      } else if (s.flips) {
        n = n * -1.0;  // control points are mirrored, and so is the product of their derivatives
      }
    }
    store(request_.positions, i, p);
    store(request_.normals, i, n);
  }

  static void store(float *array, uint64_t i, Vec3d v)
  {
    if (!array) return;
    array[3 * i] = float(v.x);
    array[3 * i + 1] = float(v.y);
    array[3 * i + 2] = float(v.z);
  }

  const CompiledScene &scene_;
  const LocateRequest &request_;
  std::vector<uint32_t> segment_of_, placement_of_;  // by the public ids
};

}  // namespace

void locate_on_patches(const CompiledScene &scene, const LocateRequest &request)
{
  Locator(scene, request).run();
}

}  // namespace gpurt
