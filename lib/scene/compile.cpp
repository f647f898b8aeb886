#include <cmath>
#include <limits>
#include <map>

#include "error.h"
#include "scene/compiled_scene.h"
#include "scene/environment_table.h"
#include "scene/lamp_texture.h"
#include "scene/light_tree.h"
#include "scene/parallel.h"
#include "scene/patch_pixels.h"
#include "scene/patches.h"
#include "scene/scene_hash.h"
#include "scene/store_geometry.h"
#include "scene/trigonometry.h"

namespace gpurt {
namespace {

// Everything that counts vertices or triangles of the whole scene is a uint32_t whose last value means none.
constexpr uint64_t max_elements = invalid_id;

// Where a geometry of the description is stored: in world space for its one instance, or as a group of its own.
struct Plan {
  uint32_t geometry;
  uint32_t instance;  // invalid_id: shared
};

class Compiler {
 public:
  Compiler(const SceneData &scene, const PatchLimits &patch_limits, const BeforeAllocation &before_allocation)
      : in_(scene), patch_limits_(patch_limits), before_allocation_(before_allocation)
  {}

  CompiledScene run()
  {
    copy_descriptions();
    const std::vector<Plan> plans = plan();
    allocate(plans);
    for (size_t i = 0; i < plans.size(); ++i) store(plans[i], out_.segments[i]);
    sources_.clear();
    cells_.clear();
    make_groups();
    place();
    count_roots();
    collect_lights();
    build_light_tree(out_);
    compile_environment(in_.environment, out_);
    out_.hash = hash_scene(out_);
    return std::move(out_);
  }

 private:
  void copy_descriptions()
  {
    out_.materials = in_.materials;
    out_.cameras = in_.cameras;
    for (const TextureData &t : in_.textures) {
      out_.textures.push_back(
          {t.texels->data(), t.width, t.height, t.format, t.wrap_u, t.wrap_v, t.nearest ? 1u : 0u});
      out_.texture_data.push_back(t.texels);
    }
  }

  // Geometries that are placed once, by instance; then shared ones, by geometry. What is not placed is not stored.
  std::vector<Plan> plan()
  {
    std::vector<uint32_t> uses(in_.geometries.size());
    for (const InstanceData &instance : in_.instances) uses[instance.geometry]++;
    std::vector<Plan> plans;
    for (size_t i = 0; i < in_.instances.size(); ++i) {
      if (uses[in_.instances[i].geometry] == 1) plans.push_back({in_.instances[i].geometry, uint32_t(i)});
    }
    num_baked_ = plans.size();
    for (size_t g = 0; g < uses.size(); ++g) {
      if (uses[g] > 1) plans.push_back({uint32_t(g), invalid_id});
    }
    return plans;
  }

  // How much larger the placements of a geometry make it.
  double stretch_of(const Plan &p) const
  {
    if (p.instance != invalid_id) return largest_stretch(in_.instances[p.instance].transform_double);
    double stretch = 0;
    for (const InstanceData &instance : in_.instances) {
      if (instance.geometry == p.geometry)
        stretch = std::max(stretch, largest_stretch(instance.transform_double));
    }
    return stretch;
  }

  // Fixes the place of every segment in the arrays.
  void allocate(const std::vector<Plan> &plans)
  {
    cut(plans);
    uint64_t vertices = 0, triangles = 0, normals = 0, uvs = 0, patch_triangles = 0;
    for (size_t i = 0; i < plans.size(); ++i) {
      const Plan &p = plans[i];
      const GeometryData &geometry = in_.geometries[p.geometry];
      auto source = make_source(geometry, cells_[i]);
      Segment s{};
      s.first_triangle = uint32_t(triangles);
      s.num_triangles = uint32_t(source->num_triangles());
      s.first_vertex = uint32_t(vertices);
      s.first_normal = source->has_normals() ? uint32_t(normals) : invalid_id;
      s.first_uv = source->has_uvs() ? uint32_t(uvs) : invalid_id;
      s.material = geometry.material;
      s.geometry = p.geometry;
      s.instance = p.instance;
      s.first_light = invalid_id;
      s.flips =
          p.instance != invalid_id && determinant(in_.instances[p.instance].transform_double) < 0 ? 1 : 0;
      vertices += source->num_vertices();
      triangles += source->num_triangles();
      normals += source->has_normals() ? source->num_vertices() : 0;
      uvs += source->has_uvs() ? source->num_vertices() : 0;
      if (vertices >= max_elements || triangles >= max_elements) {
        fail_invalid(
            "the scene has more than 2^32 - 2 stored vertices or triangles with geometry {}; split the "
            "scene, or share geometries among instances",
            p.geometry);
      }
      out_.segments.push_back(s);
      const Material &material = in_.materials[s.material];
      out_.has_blending |= material.blends != 0;
      out_.has_alpha_masks |= material.alpha_cutoff > 0 || material.blends != 0;
      out_.has_absorption |= max_component(material.absorption) > 0;
      const uint64_t num_patches =
          geometry.kind == GeometryKind::Patches ? geometry.patches.control_points.size() / 16 : 0;
      out_.patch_ranges.push_back({uint32_t(out_.num_patches), uint32_t(num_patches)});
      out_.num_patches += num_patches;
      if (num_patches != 0) patch_triangles += s.num_triangles;
      sources_.push_back(std::move(source));
    }
    if (before_allocation_) {
      before_allocation_((vertices + normals + 16 * out_.num_patches) * sizeof(Vec3f) + uvs * sizeof(Vec2f) +
                             out_.num_patches * sizeof(PatchCells) +
                             triangles * (sizeof(UInt3) + sizeof(uint32_t)),
                         patch_triangles);
    }
    out_.positions.resize(vertices);
    out_.indices.resize(triangles);
    out_.triangle_segment.resize(triangles);
    out_.normals.resize(normals);
    out_.uvs.resize(uvs);
    out_.control_points.resize(16 * out_.num_patches);
    out_.patch_cells.reserve(out_.num_patches);
    for (const std::vector<PatchCells> &cells : cells_)
      out_.patch_cells.insert(out_.patch_cells.end(), cells.begin(), cells.end());
  }

  // Decides the triangles of all patches. Those in world space are cut together: they may share boundaries.
  void cut(const std::vector<Plan> &plans)
  {
    cells_.resize(plans.size());
    std::vector<PatchSource> sources;
    std::vector<size_t> plan_of;
    const bool has_pixels = patch_limits_.pixels != 0;
    const PatchPicture picture = has_pixels ? make_patch_picture(in_.cameras, patch_limits_) : PatchPicture{};
    bool is_bound = true;
    for (size_t i = 0; i < plans.size(); ++i) {
      const Plan &p = plans[i];
      const GeometryData &geometry = in_.geometries[p.geometry];
      if (geometry.kind != GeometryKind::Patches) continue;
      const bool is_baked = p.instance != invalid_id;
      sources.push_back({&geometry.patches, p.geometry, stretch_of(p),
                         is_baked ? in_.instances[p.instance].transform_double : identity_affine,
                         is_baked ? 0 : uint32_t(i + 1)});
      plan_of.push_back(i);
      if (!has_pixels) continue;
      PixelLimits limits = pixel_limits_of(geometry.patches, placements_of(p), picture);
      sources.back().pixel_limits = std::move(limits.distances);
      is_bound = is_bound && limits.is_bound;
    }
    std::vector<std::vector<PatchCells>> cells = cut_patches(sources, patch_limits_);
    double share = 0;  // of what is allowed in pixels
    for (size_t k = 0; k < sources.size(); ++k) {
      const std::vector<double> errors = tessellation_errors(*sources[k].patches, cells[k]);
      for (size_t i = 0; i < errors.size(); ++i) {
        out_.patch_error = std::max(out_.patch_error, errors[i] * sources[k].stretch);
        if (has_pixels && errors[i] != 0) share = std::max(share, errors[i] / sources[k].pixel_limits[i]);
      }
      cells_[plan_of[k]] = std::move(cells[k]);
    }
    if (has_pixels)
      out_.patch_error_pixels =
          is_bound ? share * double(patch_limits_.pixels) : std::numeric_limits<double>::infinity();
  }

  std::vector<AffineDouble> placements_of(const Plan &p) const
  {
    if (p.instance != invalid_id) return {in_.instances[p.instance].transform_double};
    std::vector<AffineDouble> all;
    for (const InstanceData &instance : in_.instances) {
      if (instance.geometry == p.geometry) all.push_back(instance.transform_double);
    }
    return all;
  }

  void store(const Plan &p, const Segment &s)
  {
    const uint32_t index = uint32_t(&s - out_.segments.data());
    const GeometrySource &source = *sources_[index];
    const bool is_baked = p.instance != invalid_id;
    const AffineDouble transform = is_baked ? in_.instances[p.instance].transform_double : identity_affine;
    Vec3f *positions = out_.positions.data() + s.first_vertex;
    source.store_triangles(out_.indices.data() + s.first_triangle, s.first_vertex, s.flips != 0);
    source.store_positions(positions, is_baked ? &transform : nullptr);
    if (s.first_normal != invalid_id) {
      const AffineDouble inverted = inverse(transform);
      source.store_normals(out_.normals.data() + s.first_normal, is_baked ? &inverted : nullptr);
    }
    if (s.first_uv != invalid_id) source.store_uvs(out_.uvs.data() + s.first_uv);
    std::fill_n(out_.triangle_segment.begin() + s.first_triangle, s.num_triangles, index);
    const SharedArray<Vec3f> &points = in_.geometries[p.geometry].patches.control_points;
    Vec3f *control_points = out_.control_points.data() + 16 * size_t(out_.patch_ranges[index].first_patch);
    if (out_.patch_ranges[index].num_patches != 0) {
      parallel_for_each(points.size(), [&](uint64_t i) {
        const Vec3d q = to_double(points[i]);
        control_points[i] = to_float(is_baked ? transform_point(transform, q) : q);
      });
    }
    const uint64_t bad =
        find_first(source.num_vertices(), [&](uint64_t i) { return !is_finite(positions[i]); });
    if (bad != source.num_vertices()) {
      fail_invalid(
          "instance {} moves vertex {} of geometry {} beyond the range of 32-bit floats; make its transform "
          "smaller",
          p.instance, bad, p.geometry);
    }
  }

  Box bounds_of_triangles(uint64_t first, uint64_t count) const
  {
    return union_of_boxes(count, [&](uint64_t i) {
      const UInt3 c = out_.indices[first + i];
      const Vec3f p = out_.positions[c.x];
      return extend(extend(Box{p, p}, out_.positions[c.y]), out_.positions[c.z]);
    });
  }

  void make_groups()
  {
    const uint64_t num_triangles = out_.indices.size();
    const uint64_t num_baked =
        num_baked_ < out_.segments.size() ? out_.segments[num_baked_].first_triangle : num_triangles;
    out_.groups.push_back({0, uint32_t(num_baked), bounds_of_triangles(0, num_baked)});
    out_.group_geometry.push_back(invalid_id);
    for (size_t i = num_baked_; i < out_.segments.size(); ++i) {
      const Segment &s = out_.segments[i];
      out_.groups.push_back(
          {s.first_triangle, s.num_triangles, bounds_of_triangles(s.first_triangle, s.num_triangles)});
      out_.group_geometry.push_back(s.geometry);
    }
    out_.bounds = out_.groups[0].bounds;
  }

  void place()
  {
    std::vector<uint32_t> group_of(in_.geometries.size(), invalid_id);
    for (size_t g = 1; g < out_.groups.size(); ++g) group_of[out_.group_geometry[g]] = uint32_t(g);
    for (size_t i = 0; i < in_.instances.size(); ++i) {
      const InstanceData &instance = in_.instances[i];
      const uint32_t group = group_of[instance.geometry];
      if (group == invalid_id || out_.groups[group].num_triangles == 0) continue;
      const AffineDouble &t = instance.transform_double;
      Placement p{};
      p.object_to_world = to_float(t);
      p.world_to_object = to_float(inverse(t));
      // Around what either transform makes of the box: the exact one, and the one that kernels see.
      p.bounds = extend(transform_box(t, out_.groups[group].bounds),
                        transform_box(to_double(p.object_to_world), out_.groups[group].bounds));
      p.group = group;
      p.instance = uint32_t(i);
      p.first_light = invalid_id;
      p.flips = determinant(t) < 0 ? 1 : 0;
      if (!is_finite(p.bounds.lo) || !is_finite(p.bounds.hi)) {
        fail_invalid(
            "instance {} moves geometry {} beyond the range of 32-bit floats; make its transform smaller", i,
            instance.geometry);
      }
      out_.bounds = extend(out_.bounds, p.bounds);
      out_.placements.push_back(p);
    }
  }

  // What REYES takes as primitives: patches, or triangles, of all instances.
  void count_roots()
  {
    uint64_t num_roots = 0;
    const auto add = [&](uint32_t segment, uint32_t placement) {
      const PatchRange &patches = out_.patch_ranges[segment];
      out_.root_ranges.push_back({num_roots, segment, placement});
      num_roots += patches.num_patches != 0 ? patches.num_patches : out_.segments[segment].num_triangles;
    };
    for (size_t i = 0; i < num_baked_; ++i) add(uint32_t(i), invalid_id);
    for (size_t i = 0; i < out_.placements.size(); ++i)
      add(uint32_t(num_baked_ + out_.placements[i].group - 1), uint32_t(i));
    out_.root_ranges.push_back({num_roots, invalid_id, invalid_id});
  }

  // Lamps triangle by triangle, then points and spots, then distant lights.
  void collect_lights()
  {
    for (size_t i = 0; i < num_baked_; ++i) {
      Segment &s = out_.segments[i];
      add_lamp(s, invalid_id, s.first_light);
    }
    for (size_t i = 0; i < out_.placements.size(); ++i) {
      Placement &p = out_.placements[i];
      add_lamp(out_.segments[num_baked_ + p.group - 1], uint32_t(i), p.first_light);
    }
    for (const PointLightData &l : in_.lights) {
      if (l.type != LightType::Distant) out_.lights.push_back(make_light(l));
    }
    out_.num_tree_lights = uint32_t(out_.lights.size());
    for (const PointLightData &l : in_.lights) {
      if (l.type == LightType::Distant) out_.lights.push_back(make_light(l));
    }
    out_.num_distant_lights = uint32_t(out_.lights.size() - out_.num_tree_lights);
  }

  void add_lamp(const Segment &s, uint32_t placement, uint32_t &first_light)
  {
    const Material &m = out_.materials[s.material];
    if (max_component(m.emission) <= 0 || s.num_triangles == 0) return;
    // The tree has twice as many nodes as lights.
    if (out_.lights.size() + s.num_triangles + in_.lights.size() >= max_elements / 2) {
      fail_invalid(
          "the scene has more than 2^31 lamp triangles with geometry {}; make fewer of its triangles emit",
          s.geometry);
    }
    const std::vector<Vec3f> *colors = m.emission_texture != invalid_id ? &lamp_colors(s, m) : nullptr;
    first_light = uint32_t(out_.lights.size());
    for (uint32_t t = 0; t < s.num_triangles; ++t) {
      Light light{};
      light.type = LightType::Triangle;
      light.triangle = s.first_triangle + t;
      light.placement = placement;
      light.two_sided = m.two_sided_emission;
      light.color = colors ? (*colors)[t] : m.emission;
      out_.lights.push_back(light);
    }
  }

  // The mean radiance of each triangle of a lamp with a texture: above 0 wherever a part of it shines.
  const std::vector<Vec3f> &lamp_colors(const Segment &s, const Material &m)
  {
    out_.has_emission_textures = true;
    std::vector<Vec3f> &colors = lamp_colors_[s.first_triangle];
    if (!colors.empty()) return colors;
    const LampTexture &texture =
        lamp_textures_.try_emplace(m.emission_texture, out_.textures[m.emission_texture]).first->second;
    colors.resize(s.num_triangles);
    parallel_for_each(s.num_triangles, [&](uint64_t t) {
      Vec2f uv[3] = {};
      if (s.first_uv != invalid_id) {
        const Vec2f *uvs = out_.uvs.data() + s.first_uv - s.first_vertex;
        const UInt3 corner = out_.indices[s.first_triangle + t];
        uv[0] = uvs[corner.x], uv[1] = uvs[corner.y], uv[2] = uvs[corner.z];
      }
      const Vec3f mean = texture.mean(uv);
      // What shines must not have the power 0 by rounding, nor one whose inverse is infinite.
      for (int c = 0; c < 3; ++c) {
        const float color = at(m.emission, c) * at(mean, c);
        const bool shines = at(m.emission, c) > 0 && at(mean, c) > 0;
        set(colors[t], c, shines ? std::max(color, std::numeric_limits<float>::min()) : 0.0f);
      }
    });
    return colors;
  }

  static Light make_light(const PointLightData &l)
  {
    Light light{};
    light.type = l.type;
    light.triangle = light.placement = invalid_id;
    light.color = l.color;
    light.position = l.position;
    light.direction = l.direction;
    if (l.type == LightType::Spot) {
      light.cos_inner = float(cosine(l.inner_cone_angle_rad));
      light.cos_outer = float(cosine(l.outer_cone_angle_rad));
    }
    return light;
  }

  const SceneData &in_;
  const PatchLimits patch_limits_;
  const BeforeAllocation &before_allocation_;
  CompiledScene out_;
  std::vector<std::vector<PatchCells>> cells_;  // of each plan
  std::vector<std::unique_ptr<GeometrySource>> sources_;
  size_t num_baked_ = 0;                                // segments of group 0
  std::map<uint32_t, LampTexture> lamp_textures_;       // by index of the texture
  std::map<uint32_t, std::vector<Vec3f>> lamp_colors_;  // by a segment's first triangle
};

}  // namespace

CompiledScene compile_scene(const SceneData &scene, const PatchLimits &patch_limits,
                            const BeforeAllocation &before_allocation)
{
  if (const float t = patch_limits.tolerance; !(t >= 0) || !std::isfinite(t))
    fail_invalid("patch_tolerance is {}; it must be a finite number of metres, or 0 for the default", t);
  if (const float p = patch_limits.pixels; !(p >= 0) || !std::isfinite(p))
    fail_invalid("patch_pixels is {}; it must be a finite number of pixels, or 0 for no bound in pixels", p);
  return Compiler(scene, patch_limits, before_allocation).run();
}

SceneView CompiledScene::view() const
{
  SceneView v{};
  v.positions = positions.data();
  v.indices = indices.data();
  v.triangle_segment = triangle_segment.data();
  v.normals = normals.data();
  v.uvs = uvs.data();
  v.segments = segments.data();
  v.groups = groups.data();
  v.placements = placements.data();
  v.materials = materials.data();
  v.textures = textures.data();
  v.lights = lights.data();
  v.light_bundles = light_bundles.data();
  v.environment = environment;
  v.environment.row_cdf = environment_rows.empty() ? nullptr : environment_rows.data();
  v.environment.column_cdf = environment_columns.empty() ? nullptr : environment_columns.data();
  v.bounds = bounds;
  v.num_triangles = indices.size();
  v.num_groups = uint32_t(groups.size());
  v.num_placements = uint32_t(placements.size());
  v.num_segments = uint32_t(segments.size());
  v.num_materials = uint32_t(materials.size());
  v.num_tree_lights = num_tree_lights;
  v.num_distant_lights = num_distant_lights;
  v.has_alpha_masks = has_alpha_masks ? 1 : 0;
  v.has_blending = has_blending ? 1 : 0;
  v.has_absorption = has_absorption ? 1 : 0;
  v.has_emission_textures = has_emission_textures ? 1 : 0;
  return v;
}

bool CompiledScene::has_meshes() const
{
  for (size_t i = 0; i < segments.size(); ++i) {
    if (patch_ranges[i].num_patches == 0 && segments[i].num_triangles != 0) return true;
  }
  return false;
}

ReyesScene CompiledScene::reyes_view() const
{
  return {view(),
          control_points.data(),
          patch_ranges.data(),
          patch_cells.data(),
          root_ranges.data(),
          root_ranges.empty() ? 0 : uint32_t(root_ranges.size()) - 1};
}

uint64_t CompiledScene::bytes() const
{
  const auto size = [](const auto &v) { return uint64_t(v.capacity()) * sizeof(v[0]); };
  uint64_t sum = size(positions) + size(indices) + size(triangle_segment) + size(normals) + size(uvs) +
                 size(segments) + size(groups) + size(group_geometry) + size(placements) + size(materials) +
                 size(textures) + size(texture_data) + size(lights) + size(light_nodes) +
                 size(light_bundles) + size(environment_rows) + size(environment_columns) + size(cameras) +
                 size(control_points) + size(patch_ranges) + size(patch_cells) + size(root_ranges);
  for (const auto &texels : texture_data) sum += texels->size();
  return sum;
}

}  // namespace gpurt
