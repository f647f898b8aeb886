// What compile_scene makes of a description: places, lights, the environment's table, the hash.
#include <algorithm>
#include <cmath>
#include <random>

#include "core/path/light_tree.h"
#include "core/path/lights.h"
#include "scene/trigonometry.h"
#include "scene_builders.h"

namespace gpurt {
namespace {

void expect_near(Vec3f a, Vec3f b, float tolerance)
{
  EXPECT_NEAR(a.x, b.x, tolerance);
  EXPECT_NEAR(a.y, b.y, tolerance);
  EXPECT_NEAR(a.z, b.z, tolerance);
}

Vec3f face_normal(const CompiledScene &s, uint32_t triangle)
{
  const UInt3 c = s.indices[triangle];
  return normalize(cross(s.positions[c.y] - s.positions[c.x], s.positions[c.z] - s.positions[c.x]));
}

uint32_t add_lamp_material(SceneData &scene, Vec3f emission, bool two_sided = false)
{
  MaterialSettings m;
  m.base_color = {0, 0, 0};
  m.emission = emission;
  m.two_sided_emission = two_sided;
  return add_material(scene, m);
}

TEST(SceneCompile, EmptySceneHasOneEmptyGroup)
{
  const CompiledScene s = compile_scene(SceneData{}, 0);
  ASSERT_EQ(s.groups.size(), 1u);
  EXPECT_EQ(s.groups[0].num_triangles, 0u);
  EXPECT_TRUE(is_empty(s.bounds));
  EXPECT_EQ(s.view().num_triangles, 0u);
  EXPECT_EQ(s.view().environment.is_present, 0u);
  EXPECT_EQ(s.view().environment.texture, invalid_id);
}

TEST(SceneCompile, BakesWhatIsPlacedOnceAndSharesTheRest)
{
  SceneData d;
  const uint32_t shared = add_mesh(d, unit_triangle(), 0);
  const uint32_t unplaced = add_mesh(d, unit_triangle(), 0);
  const uint32_t once = add_mesh(d, unit_triangle(), 0);
  (void)unplaced;
  add_instance(d, shared, translation(10, 0, 0));
  add_instance(d, once, translation(0, 5, 0));
  add_instance(d, shared, translation(20, 0, 0));
  const CompiledScene s = compile_scene(d, 0);
  ASSERT_EQ(s.groups.size(), 2u);
  ASSERT_EQ(s.segments.size(), 2u);
  ASSERT_EQ(s.placements.size(), 2u);
  EXPECT_EQ(s.indices.size(), 2u);
  EXPECT_EQ(s.segments[0].geometry, once);
  EXPECT_EQ(s.segments[0].instance, 1u);
  EXPECT_EQ(s.segments[1].geometry, shared);
  EXPECT_EQ(s.segments[1].instance, invalid_id);
  EXPECT_EQ(s.group_geometry[1], shared);
  EXPECT_EQ(s.placements[0].instance, 0u);
  EXPECT_EQ(s.placements[1].instance, 2u);
  expect_near(s.positions[s.indices[0].x], {0, 5, 0}, 0);
  expect_near(s.positions[s.indices[1].x], {0, 0, 0}, 0);
  EXPECT_LE(s.placements[1].bounds.lo.x, 20);
  EXPECT_GE(s.placements[1].bounds.hi.x, 21);
  EXPECT_LT(s.placements[1].bounds.hi.x, 21.001f);
  EXPECT_LE(s.bounds.lo.x, 0);
  EXPECT_GE(s.bounds.hi.x, 21);
  EXPECT_GE(s.bounds.hi.y, 6);
}

TEST(SceneCompile, Group0IsOrderedByInstance)
{
  SceneData d;
  const uint32_t a = add_mesh(d, unit_triangle(), 0), b = add_mesh(d, unit_triangle(), 0);
  add_instance(d, b, identity_affine);
  add_instance(d, a, identity_affine);
  const CompiledScene s = compile_scene(d, 0);
  EXPECT_EQ(s.segments[0].geometry, b);
  EXPECT_EQ(s.segments[1].geometry, a);
  EXPECT_EQ(s.triangle_segment[1], 1u);
}

// A mirrored object shows its front where the image of its front is, baked or shared, for its normals and its light.
TEST(SceneCompile, MirroringKeepsTheFrontSide)
{
  for (bool is_shared : {false, true}) {
    SceneData d;
    const uint32_t lamp = add_lamp_material(d, {1, 1, 1});
    // Its front looks along +z.
    const uint32_t g = add_mesh(
        d, make_mesh({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}, {{0, 0, 2}, {0, 0, 2}, {0, 0, 2}}),
        lamp);
    add_instance(d, g, scaling(1, 1, -1));
    if (is_shared) add_instance(d, g, translation(5, 0, 0));
    const CompiledScene s = compile_scene(d, 0);
    const SceneView view = s.view();
    Hit hit{1, 0.25f, 0.25f, 0, is_shared ? 0u : invalid_id};
    const SurfaceHit surface = surface_at(view, hit);
    expect_near(surface.geometric_normal, {0, 0, -1}, 1e-6f);
    expect_near(surface.shading_normal, {0, 0, -1}, 1e-6f);
    ASSERT_EQ(s.num_tree_lights, is_shared ? 2u : 1u);
    ASSERT_EQ(surface.light, 0u);
    Vec3f a, b, c;
    light_triangle(view, s.lights[0], a, b, c);
    expect_near(normalize(cross(b - a, c - a)), {0, 0, -1}, 1e-6f);
    if (is_shared) {
      EXPECT_EQ(s.placements[0].flips, 1u);
      EXPECT_EQ(s.placements[1].flips, 0u);
    } else {
      EXPECT_EQ(s.segments[0].flips, 1u);
      expect_near(face_normal(s, 0), {0, 0, -1}, 1e-6f);
    }
  }
}

TEST(SceneCompile, NormalsFollowTheInverseTranspose)
{
  SceneData d;
  const Vec3f n{1, 1, 0};
  const uint32_t g = add_mesh(d, make_mesh({{0, 0, 0}, {1, -1, 0}, {0, 0, 1}}, {{0, 1, 2}}, {n, n, n}), 0);
  add_instance(d, g, scaling(4, 1, 1));
  const CompiledScene s = compile_scene(d, 0);
  // The plane x + y = 0 becomes x / 4 + y = 0.
  expect_near(s.normals[0], normalize(Vec3f{0.25f, 1, 0}), 1e-7f);
}

TEST(SceneCompile, ZeroNormalsTakeThatOfTheFaces)
{
  SceneData d;
  // The last vertex belongs to no face, so that nothing tells its normal.
  const uint32_t g = add_mesh(d,
                              make_mesh({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {9, 9, 9}}, {{0, 1, 2}},
                                        {{0, 0, 0}, {0, 3, 0}, {0, 0, 0}, {0, 0, 0}}),
                              0);
  add_instance(d, g, identity_affine);
  const CompiledScene s = compile_scene(d, 0);
  expect_near(s.normals[0], {0, 0, 1}, 0);
  expect_near(s.normals[1], {0, 1, 0}, 0);
  expect_near(s.normals[2], {0, 0, 1}, 0);
  EXPECT_NEAR(length(s.normals[3]), 1, 1e-6f);
}

TEST(SceneCompile, NamesTheInstanceThatLeavesTheFloatRange)
{
  SceneData d;
  const uint32_t g = add_mesh(d, make_mesh({{0, 0, 0}, {1e20f, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}), 0);
  add_instance(d, g, scaling(1, 1, 1));
  SceneData shared = d;
  d.instances[0].transform_double = scaling(1e30, 1, 1);
  expect_contains(error_of([&] { compile_scene(d, 0); }), "instance 0 moves vertex 1 of geometry 0");
  add_instance(shared, g, scaling(1e30, 1, 1));
  expect_contains(error_of([&] { compile_scene(shared, 0); }), "instance 1 moves geometry 0");
}

TEST(SceneCompile, LargeOffsetsAreRoundedOnce)
{
  SceneData d;
  const Vec3f v{0.1f, 0.2f, 0.3f};
  const uint32_t g = add_mesh(d, make_mesh({v, v, v}, {{0, 1, 2}}), 0);
  AffineDouble t = scaling(100, 100, 100);
  t[3] = 1e6;
  add_instance(d, g, t);
  const CompiledScene s = compile_scene(d, 0);
  EXPECT_EQ(s.positions[0].x, float(100.0 * double(0.1f) + 1e6));
}

TEST(SceneCompile, LightsStandInTheirOrder)
{
  SceneData d;
  const uint32_t lamp = add_lamp_material(d, {0, 2, 0});
  const uint32_t once =
      add_mesh(d, make_mesh({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {2, 0, 0}}, {{0, 1, 2}, {0, 1, 3}}), lamp);
  const uint32_t shared = add_mesh(d, unit_triangle(), lamp);
  const uint32_t dark = add_mesh(d, unit_triangle(), 0);
  add_instance(d, dark, identity_affine);
  add_instance(d, shared, translation(0, 0, 1));
  add_instance(d, once, identity_affine);
  add_instance(d, shared, translation(0, 0, 2));
  add_light(d, {LightType::Distant, {1, 1, 1}, {}, {0, -2, 0}, 0, 0});
  add_light(d, {LightType::Point, {1, 1, 1}, {0, 5, 0}, {}, 0, 0});
  add_light(d, {LightType::Spot, {1, 1, 1}, {0, 5, 0}, {0, 0, -3}, 0.1f, 0.5f});
  const CompiledScene s = compile_scene(d, 0);
  ASSERT_EQ(s.lights.size(), 7u);
  EXPECT_EQ(s.num_tree_lights, 6u);
  EXPECT_EQ(s.num_distant_lights, 1u);
  EXPECT_EQ(s.segments[0].first_light, invalid_id);
  EXPECT_EQ(s.segments[1].first_light, 0u);
  EXPECT_EQ(s.segments[2].first_light, invalid_id);
  EXPECT_EQ(s.placements[0].first_light, 2u);
  EXPECT_EQ(s.placements[1].first_light, 3u);
  EXPECT_EQ(s.lights[3].placement, 1u);
  EXPECT_EQ(s.lights[3].triangle, s.segments[2].first_triangle);
  EXPECT_EQ(s.lights[4].type, LightType::Point);
  EXPECT_EQ(s.lights[5].type, LightType::Spot);
  EXPECT_EQ(s.lights[5].cos_outer, float(std::cos(double(0.5f))));
  EXPECT_EQ(s.lights[6].type, LightType::Distant);
  expect_near(s.lights[6].direction, {0, -1, 0}, 0);
  // The second triangle of `once` has no area: a leaf of the tree that is never chosen.
  ASSERT_EQ(s.light_nodes.size(), 11u);
  for (const LightNode &n : s.light_nodes) {
    if (n.is_leaf && n.child == 1) {
      EXPECT_EQ(n.power, 0);
    } else {
      EXPECT_GT(n.power, 0);
    }
  }
}

// Lamps of all kinds, strewn at random.
SceneData make_many_lights(uint32_t count, uint32_t seed)
{
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> unit(0, 1);
  const auto point = [&](float scale) {
    const float x = unit(random), y = unit(random), z = unit(random);
    return Vec3f{scale * (x - 0.5f), scale * (y - 0.5f), scale * (z - 0.5f)};
  };
  SceneData d;
  const uint32_t one = add_lamp_material(d, {1, 2, 3}), two = add_lamp_material(d, {5, 0, 0}, true);
  for (uint32_t material : {one, two}) {
    std::vector<Vec3f> vertices;
    std::vector<UInt3> triangles;
    for (uint32_t i = 0; i < count; ++i) {
      const Vec3f p = point(20);
      for (int k = 0; k < 3; ++k) vertices.push_back(p + point(0.5f));
      triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
    }
    const uint32_t g = add_mesh(d, make_mesh(vertices, triangles), material);
    add_instance(d, g, identity_affine);
    if (material == two) add_instance(d, g, scaling(-2, 1, 1));
  }
  for (uint32_t i = 0; i < count; ++i) {
    add_light(d, {LightType::Point, {1, 1, 1}, point(20), {}, 0, 0});
    add_light(d, {LightType::Spot, {9, 1, 1}, point(20), point(1), 0.1f, 0.2f + unit(random)});
  }
  return d;
}

// Every tree: each light is a leaf once, at its path, within the bounds of all its ancestors.
void check_light_tree(const CompiledScene &s)
{
  ASSERT_EQ(s.light_nodes.size(), 2 * size_t(s.num_tree_lights) - 1);
  std::vector<int> visits(s.light_nodes.size());
  for (uint32_t l = 0; l < s.num_tree_lights; ++l) {
    uint32_t i = 0;
    uint64_t path = s.lights[l].tree_path;
    std::vector<uint32_t> ancestors;
    for (int depth = 0; !s.light_nodes[i].is_leaf; ++depth) {
      ASSERT_LT(depth, 64);
      ancestors.push_back(i);
      const uint32_t child = s.light_nodes[i].child;
      ASSERT_GT(child, i);
      i = child + uint32_t(path & 1);
      path >>= 1;
      ASSERT_LT(i, s.light_nodes.size());
    }
    ASSERT_EQ(path, 0u);
    ASSERT_EQ(s.light_nodes[i].child, l);
    visits[i]++;
    const LightNode &leaf = s.light_nodes[i];
    for (uint32_t a : ancestors) {
      const LightNode &n = s.light_nodes[a];
      if (leaf.power <= 0) continue;
      EXPECT_GE(n.power, leaf.power * 0.9999f);
      for (int k = 0; k < 3; ++k) {
        EXPECT_LE(at(n.bounds.lo, k), at(leaf.bounds.lo, k));
        EXPECT_GE(at(n.bounds.hi, k), at(leaf.bounds.hi, k));
      }
      EXPECT_LE(n.cos_emit, leaf.cos_emit);
      // The leaf's cone lies in the node's: the angle between the axes plus its own is at most the node's. 1e-3 rad
      // allow for cosines near 1 in float.
      double between = dot(to_double(n.axis), to_double(leaf.axis));
      if (n.two_sided) between = std::fabs(between);
      const double needed = std::acos(std::clamp(between, -1.0, 1.0)) + std::acos(double(leaf.cos_theta));
      EXPECT_LE(std::min(needed, pi_double), std::acos(double(n.cos_theta)) + 1e-3);
      EXPECT_TRUE(n.two_sided || !leaf.two_sided);
    }
  }
  for (size_t i = 0; i < visits.size(); ++i) EXPECT_EQ(visits[i], s.light_nodes[i].is_leaf ? 1 : 0);
}

TEST(SceneLightTree, HoldsEveryLightOnce)
{
  for (uint32_t count : {1u, 2u, 7u, 300u})
    check_light_tree(compile_scene(make_many_lights(count, count), 0));
}

TEST(SceneLightTree, StaysWithin64LevelsForAGeometricSeries)
{
  SceneData d;
  for (int i = 0; i < 120; ++i)
    add_light(d, {LightType::Point, {1, 1, 1}, {std::ldexp(1.0f, -i), 0, 0}, {}, 0, 0});
  for (int i = 0; i < 1000; ++i) add_light(d, {LightType::Point, {1, 1, 1}, {2, 0, 0}, {}, 0, 0});
  check_light_tree(compile_scene(d, 0));
}

// Where a light can contribute, the tree offers it: no light is lost to rounding of the bounds.
TEST(SceneLightTree, NeverLosesAContribution)
{
  const CompiledScene s = compile_scene(make_many_lights(40, 3), 0);
  const SceneView view = s.view();
  std::mt19937 random(1);
  std::uniform_real_distribution<float> unit(0, 1);
  int num_lit = 0;
  for (int i = 0; i < 300; ++i) {
    const float x = unit(random), y = unit(random), z = unit(random);
    const Vec3f p = (Vec3f{x, y, z} - vec3(0.5f)) * 30;
    const Vec3f n = normalize(Vec3f{unit(random) - 0.5f, unit(random) - 0.5f, unit(random) - 0.5f});
    double sum = 0;
    for (uint32_t l = 0; l < s.num_tree_lights; ++l) {
      const float probability = light_tree_probability(view, p, n, l);
      sum += probability;
      const Light &light = s.lights[l];
      Vec3f q = light.position;
      float emitted = 1;
      if (light.type == LightType::Triangle) {
        Vec3f a, b, c;
        light_triangle(view, light, a, b, c);
        q = (a + b + c) * (1.0f / 3);
        const float cos_light = dot(normalize(cross(b - a, c - a)), normalize(p - q));
        emitted = light.two_sided ? std::fabs(cos_light) : cos_light;
      } else if (light.type == LightType::Spot) {
        emitted = spot_falloff(light, normalize(p - q));
      }
      if (emitted > 1e-3f && dot(normalize(q - p), n) > 1e-3f) {
        num_lit++;
        ASSERT_GT(probability, 0) << "light " << l;
      }
    }
    EXPECT_LE(sum, 1.0001);
  }
  EXPECT_GT(num_lit, 1000);
}

TEST(SceneCompile, IsTheSameEveryTime)
{
  const SceneData d = make_many_lights(3000, 5);
  const CompiledScene a = compile_scene(d, 0), b = compile_scene(d, 0);
  EXPECT_EQ(a.hash, b.hash);
  ASSERT_EQ(a.light_nodes.size(), b.light_nodes.size());
  EXPECT_EQ(
      0, std::memcmp(a.light_nodes.data(), b.light_nodes.data(), a.light_nodes.size() * sizeof(LightNode)));
}

TEST(SceneCompile, HashSeesWhatDecidesAnImage)
{
  const auto hash = [](const SceneData &d) { return compile_scene(d, 0).hash; };
  SceneData d = make_many_lights(2, 1);
  const uint64_t before = hash(d);
  SceneData e = d;
  e.materials[1].base_color.x = 0.5f;
  EXPECT_NE(hash(e), before);
  e = d;
  e.environment.radiance = {1, 1, 1};
  EXPECT_NE(hash(e), before);
  e = d;
  e.lights.pop_back();
  EXPECT_NE(hash(e), before);
  e = d;
  e.instances[0].transform_double[3] += 1;
  EXPECT_NE(hash(e), before);
}

uint32_t add_float_texture(SceneData &d, uint32_t width, uint32_t height, const std::vector<float> &rgba)
{
  auto bytes = std::make_shared<std::vector<std::byte>>(rgba.size() * sizeof(float));
  std::memcpy(bytes->data(), rgba.data(), bytes->size());
  TextureData t;
  t.width = width;
  t.height = height;
  t.format = TexelFormat::Rgba32f;
  t.texels = bytes;
  return add_texture(d, t);
}

TEST(SceneEnvironment, DensityIsProportionalForAConstantImage)
{
  SceneData d;
  const uint32_t w = 8, h = 4;
  std::vector<float> rgba(w * h * 4, 3.0f);
  const uint32_t texture = add_float_texture(d, w, h, rgba);
  set_environment(d, {{2, 2, 2}, texture});
  const CompiledScene s = compile_scene(d, 0);
  const Environment e = s.view().environment;
  ASSERT_TRUE(e.row_cdf);
  EXPECT_NEAR(e.mean_luminance, 6, 1e-5);
  // Uniform over the sphere, 1 / (4 pi), up to the variation of the sine within a row of pi / 8.
  for (Vec3f v : {Vec3f{1, 0, 0}, Vec3f{0, 0, -1}, normalize(Vec3f{1, 1, 1}), normalize(Vec3f{-1, -2, 1})}) {
    EXPECT_NEAR(environment_pdf(e, v) * 4 * pi, 1, 0.25f);
  }
}

// One bright texel among black ones: density is positive exactly as far as the interpolation reaches.
// Backends copy texture_data: what every texture points to must be there, the environment's own texture included.
TEST(SceneEnvironment, SharesTheTexelsOfItsTexture)
{
  SceneData d;
  add_float_texture(d, 2, 1, std::vector<float>(2 * 4, 0.5f));
  const uint32_t texture = add_float_texture(d, 4, 2, std::vector<float>(4 * 2 * 4, 1.0f));
  set_environment(d, {{1, 1, 1}, texture});
  const CompiledScene s = compile_scene(d, 0);
  ASSERT_EQ(s.textures.size(), 3u);
  EXPECT_EQ(s.environment.texture, 2u);
  EXPECT_EQ(s.textures[2].texels, s.textures[texture].texels);
  for (const Texture &t : s.textures) {
    EXPECT_EQ(1, std::count_if(s.texture_data.begin(), s.texture_data.end(),
                               [&](const auto &texels) { return texels->data() == t.texels; }));
  }
}

TEST(SceneEnvironment, DensityIsPositiveWhereRadianceIs)
{
  for (uint32_t bright : {0u, 7u, 15u, 16u * 7 + 3, 16u * 4 + 9}) {
    SceneData d;
    const uint32_t w = 16, h = 8;
    std::vector<float> rgba(w * h * 4, 0.0f);
    rgba[4 * bright + 2] = 1e4f;
    rgba[4 * 60 + 2] = 1e-6f;  // a faint one beside it must not vanish
    const uint32_t texture = add_float_texture(d, w, h, rgba);
    set_environment(d, {{1, 1, 1}, texture});
    const CompiledScene s = compile_scene(d, 0);
    const SceneView view = s.view();
    std::mt19937 random(bright);
    std::uniform_real_distribution<float> unit(0, 1);
    int num_bright = 0;
    double total = 0;
    const int num_samples = 40000;
    for (int i = 0; i < num_samples; ++i) {
      const float y = 1 - 2 * unit(random), r = std::sqrt(1 - y * y), phi = 2 * pi * unit(random);
      const Vec3f v{r * std::cos(phi), y, r * std::sin(phi)};
      const float pdf = environment_pdf(view.environment, v);
      const float radiance = max_component(environment_radiance(view, v));
      total += pdf;
      if (radiance > 0) {
        num_bright++;
        ASSERT_GT(pdf, 0);
        // A cell's weight is its mean: interpolation exceeds it at most four times (a corner of a quarter texel), and
        // the sine varies within a row.
        if (radiance > 10) {
          EXPECT_LT(radiance * 0.0722f / (pdf * 4 * pi * view.environment.mean_luminance), 10);
        }
      }
    }
    EXPECT_GT(num_bright, 100);
    EXPECT_NEAR(total / num_samples * 4 * pi, 1, 0.35);  // a noisy integral over few cells
    for (uint32_t y = 0; y <= view.environment.height; ++y) {
      if (y > 0) {
        EXPECT_GE(view.environment.row_cdf[y], view.environment.row_cdf[y - 1]);
      }
    }
    EXPECT_EQ(view.environment.row_cdf[view.environment.height], 1);
  }
}

TEST(SceneEnvironment, WrapsAroundWhateverTheTextureSays)
{
  SceneData d;
  const uint32_t texture = add_float_texture(d, 2, 1, {1, 1, 1, 1, 3, 3, 3, 1});
  d.textures[texture].wrap_u = Wrap::Clamp;
  d.textures[texture].wrap_v = Wrap::Repeat;
  set_environment(d, {{1, 1, 1}, texture});
  const CompiledScene s = compile_scene(d, 0);
  // Straight ahead along -Z lies the seam: the mean of the two texels.
  EXPECT_NEAR(environment_radiance(s.view(), {0, 0, -1}).x, 2, 1e-5);
}

TEST(SceneEnvironment, BlackMeansNone)
{
  SceneData d;
  const uint32_t texture = add_float_texture(d, 2, 1, std::vector<float>(8, 0.0f));
  set_environment(d, {{1, 1, 1}, texture});
  const CompiledScene s = compile_scene(d, 0);
  EXPECT_EQ(s.view().environment.is_present, 0u);
  EXPECT_EQ(s.view().environment.row_cdf, nullptr);
}

TEST(SceneTrigonometry, AgreesWithTheLibrary)
{
  for (double x = 0; x <= pi_double; x += 0.001) {
    EXPECT_NEAR(cosine(x), std::cos(x), 2e-15);  // 4 s times the sine's error, and its rounding
    if (x <= pi_double / 2) {
      EXPECT_NEAR(sine(x), std::sin(x), 1e-15);
    }
  }
}

}  // namespace
}  // namespace gpurt
