// A valley with a pond, trees, grass and rocks under sun and sky: about a million triangles, most of them instanced,
// alpha masks on leaves.
#include <algorithm>

#include "scenes.h"
#include "texture.h"

namespace cli::scenes {

namespace {

constexpr double half_size = 90;  // of the land, metres
constexpr double water_level = -1.1;
constexpr Vec3 pond{-5, 0, -6};
constexpr Vec3 eye{5, 0, 20};

double smooth_step(double a, double b, double x)
{
  const double t = std::clamp((x - a) / (b - a), 0.0, 1.0);
  return t * t * (3 - 2 * t);
}

double pond_distance(double x, double z) { return std::hypot((x - pond.x) / 17, (z - pond.z) / 11); }

double land(double x, double z)
{
  const double r = std::hypot(x, z);
  const double rolling = 1.5 * fractal_noise({x * 0.035, 0.5, z * 0.035}, 4, 1) +
                         0.06 * fractal_noise({x * 0.6, 1.5, z * 0.6}, 3, 7);
  // Hills close the view; the ridge is rougher than the slopes.
  const double ridge = 1 + 0.55 * fractal_noise({x * 0.03, 2.5, z * 0.03}, 5, 3);
  const double hills = 24 * smooth_step(38, 88, r) * std::max(ridge, 0.2);
  const double basin = -3.2 * (1 - smooth_step(0.45, 1.25, pond_distance(x, z)));
  return rolling + hills + basin;
}

// `y` and `slope` are those of the land there.
Vec3 land_color(double x, double z, double y, double slope)
{
  const double n = fractal_noise({x * 0.25, 0.3, z * 0.25}, 4, 21), fine = noise({x * 3.1, 0.7, z * 3.1}, 23);
  Vec3 color = mix({0.085, 0.115, 0.030}, {0.15, 0.145, 0.050}, smooth_step(-0.5, 0.7, n));
  color = mix(color, {0.17, 0.125, 0.075},
              smooth_step(0.35, 0.75, n + 0.5 * noise({x * 0.05, 0, z * 0.05}, 31)));  // bare earth
  color = mix(color, Vec3{0.26, 0.245, 0.225} * (0.8 + 0.3 * n),
              smooth_step(0.62, 0.95, slope + 0.1 * n));  // rock
  color = mix(color, {0.23, 0.19, 0.12},
              1 - smooth_step(water_level + 0.1, water_level + 0.55, y + 0.1 * n));  // shore
  return color * (1 + 0.18 * fine);
}

std::vector<uint8_t> land_image(int size)
{
  const double step = 2 * half_size / size;
  std::vector<double> heights;  // at texel centres
  for (int j = 0; j < size; ++j) {
    for (int i = 0; i < size; ++i)
      heights.push_back(land((i + 0.5) * step - half_size, (j + 0.5) * step - half_size));
  }
  const auto height = [&](int i, int j) {
    return heights[size_t(std::clamp(j, 0, size - 1)) * size_t(size) + size_t(std::clamp(i, 0, size - 1))];
  };
  return make_png(size, size, false, [&](double u, double v) {
    const int i = int(u * size), j = int(v * size), reach = std::max(1, int(0.4 / step));
    const double slope =
        std::hypot(height(i + reach, j) - height(i - reach, j), height(i, j + reach) - height(i, j - reach)) /
        (2 * reach * step);
    return Texel{land_color((2 * u - 1) * half_size, (2 * v - 1) * half_size, height(i, j), slope)};
  });
}

// Bark and leaves of one tree.
struct Tree {
  Mesh wood, leaves;
};

// A leaf card: a quad that stands on `foot`, `up` long, `side` to each side.
void add_card(Mesh &mesh, Vec3 foot, Vec3 up, Vec3 side)
{
  mesh.add_quad(foot - side, foot + side, foot + side + up, foot - side + up);
}

Vec3 any_perpendicular(Vec3 d, double angle)
{
  const Vec3 u = normalize(cross(d, std::abs(d.y) < 0.9 ? Vec3{0, 1, 0} : Vec3{1, 0, 0})), v = cross(d, u);
  return u * std::cos(angle) + v * std::sin(angle);
}

void grow_branch(Tree &tree, Sequence &random, Vec3 start, Vec3 direction, double reach, double radius,
                 int level, double detail)
{
  // Bends upwards a little, with chance.
  std::vector<Vec3> path = {start};
  std::vector<double> radii = {radius};
  const int segments = level == 0 ? 7 : 4;
  Vec3 d = direction;
  for (int i = 0; i < segments; ++i) {
    const double wander = level == 0 ? 0.10 : 0.22;
    d = normalize(d + Vec3{random.range(-wander, wander),
                           random.range(-wander, wander) + (level == 0 ? 0.05 : 0.10),
                           random.range(-wander, wander)});
    path.push_back(path.back() + d * (reach / segments));
    radii.push_back(radius * (1 - 0.82 * (i + 1) / segments));
  }
  const int sides = std::max(3, int(std::lround((level == 0 ? 10 : level == 1 ? 6 : 4) * std::sqrt(detail))));
  tree.wood.append(tube(path, radii, sides));

  const auto point_at = [&](double t) {
    const double s = t * segments;
    const auto i = size_t(std::min(int(s), segments - 1));
    return mix(path[i], path[i + 1], s - double(i));
  };
  if (level == 2) {
    const int num_cards = std::max(2, int(std::lround(10 * detail)));
    for (int k = 0; k < num_cards; ++k) {
      const double t = 0.25 + 0.75 * (k + random.next()) / num_cards;
      const Vec3 up = normalize(d * 0.7 + any_perpendicular(d, random.range(0, 2 * pi)) + Vec3{0, 0.25, 0});
      const double size = random.range(0.65, 1.0);
      add_card(tree.leaves, point_at(t), up * size,
               any_perpendicular(up, random.range(0, 2 * pi)) * (0.5 * size));
    }
    return;
  }
  const int num_children = level == 0 ? 13 : 7;
  double angle = random.range(0, 2 * pi);
  for (int k = 0; k < num_children; ++k) {
    const double t =
        (level == 0 ? 0.34 : 0.30) + (level == 0 ? 0.64 : 0.68) * (k + 0.5 * random.next()) / num_children;
    angle += 2.4;  // the golden angle, as plants have it
    const Vec3 side = any_perpendicular(level == 0 ? Vec3{0, 1, 0} : d, angle + random.range(-0.3, 0.3));
    const Vec3 forward = level == 0 ? Vec3{0, 1, 0} : d;
    const double spread = level == 0 ? 1.25 - 0.55 * t : 1.0;
    const double length_factor = level == 0 ? 0.58 * (1.15 - t * 0.75) : 0.42;
    grow_branch(tree, random, point_at(t), normalize(side * spread + forward * 0.75),
                reach * length_factor * random.range(0.8, 1.2),
                radius * (level == 0 ? 0.36 * (1.2 - 0.6 * t) : 0.42), level + 1, detail);
  }
}

Tree broad_leaved_tree(uint64_t seed, double height, double detail)
{
  Tree tree;
  Sequence random(seed);
  grow_branch(tree, random, {0, -0.3, 0}, {0, 1, 0}, height, height * 0.026, 0, detail);
  return tree;
}

Tree fir_tree(uint64_t seed, double height, double detail)
{
  Tree tree;
  Sequence random(seed);
  std::vector<Vec3> path;
  std::vector<double> radii;
  for (int i = 0; i <= 8; ++i) {
    path.push_back({0.02 * height * noise({i * 0.6, seed * 1.7, 0}), height * i / 8 - 0.3,
                    0.02 * height * noise({0, i * 0.6, seed * 2.3})});
    radii.push_back(height * 0.018 * (1 - 0.97 * i / 8.0));
  }
  tree.wood = tube(path, radii, 9);
  const int num_whorls = std::max(6, int(std::lround(26 * detail)));
  for (int w = 0; w < num_whorls; ++w) {
    const double t = 0.12 + 0.87 * w / num_whorls;
    const double reach = height * 0.27 * std::pow(1 - t, 0.75) + 0.18;
    const int num_branches = std::max(4, int(std::lround((6 + 5 * (1 - t)) * detail)));
    const double turn = random.range(0, 2 * pi);
    for (int k = 0; k < num_branches; ++k) {
      const double angle = turn + 2 * pi * (k + random.range(-0.25, 0.25)) / num_branches;
      const Vec3 out{std::cos(angle), 0, std::sin(angle)};
      const Vec3 foot{0, height * t + random.range(-0.1, 0.1) * height / num_whorls, 0};
      const double length_here = reach * random.range(0.8, 1.1), droop = random.range(0.10, 0.28);
      // Two pieces: out and down, then level, once flat and once on edge.
      const Vec3 knee = foot + out * (0.55 * length_here) + Vec3{0, -droop * 0.55 * length_here, 0};
      const Vec3 tip = knee + out * (0.45 * length_here) + Vec3{0, -droop * 0.15 * length_here, 0};
      const Vec3 flat = cross(out, {0, 1, 0}) * (0.30 * length_here);
      for (const Vec3 &side : {flat, Vec3{0, 0.20 * length_here, 0}}) {
        const auto first = uint32_t(tree.leaves.positions.size());
        tree.leaves.positions.insert(tree.leaves.positions.end(), {foot - side, foot + side, knee - side,
                                                                   knee + side, tip - side, tip + side});
        tree.leaves.uvs.insert(tree.leaves.uvs.end(), {{0, 1}, {0, 0}, {0.55, 1}, {0.55, 0}, {1, 1}, {1, 0}});
        for (uint32_t i = first; i < first + 4; i += 2)
          tree.leaves.triangles.insert(tree.leaves.triangles.end(), {{i, i + 2, i + 3}, {i, i + 3, i + 1}});
      }
    }
  }
  return tree;
}

Mesh rock(uint32_t seed, int subdivisions)
{
  Mesh mesh = icosphere(subdivisions, false);
  for (Vec3 &p : mesh.positions) {
    const double coarse = fractal_noise(p * 1.1, 2, seed), fine = fractal_noise(p * 3.5, 4, seed + 50);
    p = p * (1 + 0.40 * coarse + 0.12 * fine);
    // Split faces: a few planes cut the lump.
    for (uint32_t k = 0; k < 5; ++k) {
      const Vec3 n =
          normalize({noise({k * 3.3, seed * 1.0, 0.5}, 90), noise({0.5, k * 3.3, seed * 1.0}, 91) + 0.2,
                     noise({seed * 1.0, 0.5, k * 3.3}, 92)});
      const double over = dot(p, n) - 0.78;
      if (over > 0) p = p - n * (0.85 * over);
    }
    p.y *= 0.75;
  }
  // Smooth normals from the faces around a vertex.
  mesh.normals.assign(mesh.positions.size(), {});
  for (const auto &[a, b, c] : mesh.triangles) {
    const Vec3 n = cross(mesh.positions[b] - mesh.positions[a], mesh.positions[c] - mesh.positions[a]);
    for (uint32_t v : {a, b, c}) mesh.normals[v] = mesh.normals[v] + n;
  }
  for (Vec3 &n : mesh.normals) n = normalize(n);
  return mesh;
}

// Crossed quads with blades on them.
Mesh grass_tuft(uint64_t seed)
{
  Mesh mesh;
  Sequence random(seed);
  for (int k = 0; k < 7; ++k) {
    const double angle = random.range(0, pi), size = random.range(0.18, 0.36);
    const Vec3 side = Vec3{std::cos(angle), 0, std::sin(angle)} * (0.6 * size);
    const Vec3 foot{random.range(-0.25, 0.25), -0.03, random.range(-0.25, 0.25)};
    add_card(mesh, foot, Vec3{random.range(-0.2, 0.2), 1, random.range(-0.2, 0.2)} * size, side);
  }
  return mesh;
}

// The pond as a closed solid: a wavy top over a box that ends below the ground.
Mesh water(int n)
{
  const double x0 = pond.x - 26, x1 = pond.x + 26, z0 = pond.z - 18, z1 = pond.z + 18,
               bottom = water_level - 6;
  const auto height = [](double x, double z) {
    // Still at the rim, where the sides begin.
    return water_level + 0.010 * fractal_noise({x * 0.9, 0.2, z * 2.2}, 3, 61);
  };
  Mesh mesh = height_field(x0, z0, x1, z1, n, height);
  mesh.uvs.clear();
  const auto add_side = [&](Vec3 from, Vec3 to) {
    // Shares the rim of the top, vertex by vertex, so that the solid is closed.
    for (int i = 0; i < n; ++i) {
      Vec3 a = mix(from, to, double(i) / n), b = mix(from, to, double(i + 1) / n);
      a.y = height(a.x, a.z);
      b.y = height(b.x, b.z);
      const Vec3 normal = normalize(cross(b - a, Vec3{0, 1, 0}));
      const auto first = uint32_t(mesh.positions.size());
      mesh.positions.insert(mesh.positions.end(), {{a.x, bottom, a.z}, {b.x, bottom, b.z}, b, a});
      mesh.normals.insert(mesh.normals.end(), 4, normal);
      mesh.triangles.insert(mesh.triangles.end(),
                            {{first, first + 1, first + 2}, {first, first + 2, first + 3}});
    }
  };
  add_side({x0, 0, z1}, {x1, 0, z1});
  add_side({x1, 0, z1}, {x1, 0, z0});
  add_side({x1, 0, z0}, {x0, 0, z0});
  add_side({x0, 0, z0}, {x0, 0, z1});
  const auto first = uint32_t(mesh.positions.size());
  mesh.positions.insert(mesh.positions.end(),
                        {{x0, bottom, z0}, {x1, bottom, z0}, {x1, bottom, z1}, {x0, bottom, z1}});
  mesh.normals.insert(mesh.normals.end(), 4, {0, -1, 0});
  mesh.triangles.insert(mesh.triangles.end(), {{first, first + 1, first + 2}, {first, first + 2, first + 3}});
  return mesh;
}

bool is_dry(double x, double z, double margin) { return land(x, z) > water_level + margin; }

Matrix upright(double x, double z, double sink, double turn, double scale)
{
  return translation({x, land(x, z) - sink, z}) * rotation({0, 1, 0}, turn) * scaling({scale, scale, scale});
}

}  // namespace

void make_outdoor(GlbWriter &glb, const SceneOptions &options)
{
  const double detail = options.detail;
  const auto scaled = [&](int n, int least) { return std::max(least, int(std::lround(n * detail))); };

  // Land: the texture holds the colours of the whole of it.
  const int land_texture = glb.add_texture("land", land_image(std::clamp(scaled(2048, 64), 64, 2048)), false);
  const int ground = glb.add_lambert("ground", {1, 1, 1}, land_texture);
  glb.place(
      "land",
      glb.add_mesh("land", height_field(-half_size, -half_size, half_size, half_size, scaled(400, 16), land),
                   ground));
  glb.place("pond",
            glb.add_mesh("pond", water(scaled(96, 8)), glb.add_glass("water", {0.93, 0.97, 0.96}, 1.33)));

  // Trees: three kinds, each stored once or twice and placed many times.
  const int bark_material = glb.add_lambert("bark", {1, 1, 1}, glb.add_texture("bark", bark(256), true));
  const int leaf_material = glb.add_mask("leaves", glb.add_texture("leaves", leaf_twig(256), false));
  const int needle_material = glb.add_mask("needles", glb.add_texture("needles", needle_twig(256), false));
  std::vector<int> trees;
  const double tree_detail = std::max(detail, 0.2);
  for (uint64_t seed : {1, 2}) {
    const Tree tree = broad_leaved_tree(seed, 9, tree_detail);
    trees.push_back(
        glb.add_mesh("broad-leaved tree", {{&tree.wood, bark_material}, {&tree.leaves, leaf_material}}));
  }
  for (uint64_t seed : {3, 4}) {
    const Tree tree = fir_tree(seed, 12, tree_detail);
    trees.push_back(glb.add_mesh("fir", {{&tree.wood, bark_material}, {&tree.leaves, needle_material}}));
  }
  Sequence random(2009);
  // A few stand where they frame the view, the others by chance, denser up the hills.
  glb.place("tree", trees[0], upright(13.0, 4.0, 0, 0.4, 1.15));
  glb.place("tree", trees[1], upright(-17.5, 2.0, 0, 2.0, 1.05));
  glb.place("tree", trees[2], upright(9.5, -24.0, 0, 1.0, 1.1));
  glb.place("tree", trees[3], upright(-24.0, -20.0, 0, 4.0, 1.2));
  const int num_trees = scaled(105, 4);
  for (int placed = 0, tries = 0; placed < num_trees && tries < 100000; ++tries) {
    const double x = random.range(-84, 84), z = random.range(-84, 40), r = std::hypot(x, z);
    const double chance = random.next(), scale = random.range(0.7, 1.35), turn = random.range(0, 2 * pi);
    const bool in_view = std::abs(x - eye.x) < 9 && z > -12;
    if (!is_dry(x, z, 0.5) || in_view || pond_distance(x, z) < 1.35 || chance > smooth_step(10, 60, r))
      continue;
    const bool is_fir =
        fractal_noise({x * 0.03, 4, z * 0.03}, 2, 77) + 0.012 * (r - 40) + random.range(-0.3, 0.3) > 0;
    glb.place("tree", trees[size_t(is_fir ? 2 + placed % 2 : placed % 2)], upright(x, z, 0.05, turn, scale));
    placed++;
  }

  std::vector<int> rocks;
  const int stone = glb.add_lambert("stone", {0.30, 0.285, 0.265});
  for (uint32_t seed : {1u, 2u, 3u})
    rocks.push_back(
        glb.add_mesh("rock", rock(seed, std::clamp(4 + int(std::lround(std::log2(detail))), 1, 5)), stone));
  const int num_rocks = scaled(120, 3);
  for (int placed = 0, tries = 0; placed < num_rocks && tries < 100000; ++tries) {
    const double x = random.range(-60, 60), z = random.range(-60, 19),
                 size = 0.12 + 0.9 * std::pow(random.next(), 3.0);
    const double turn = random.range(0, 2 * pi), tilt = random.range(-0.3, 0.3);
    const double shore = pond_distance(x, z);
    // Most lie around the pond.
    if (!(shore > 0.75 && (shore < 1.45 || random.next() < 0.12)) || (std::abs(x - eye.x) < 2 && z > 10))
      continue;
    glb.place("rock", rocks[size_t(placed % 3)],
              translation({x, land(x, z) + 0.15 * size, z}) * rotation({0, 1, 0}, turn) *
                  rotation({1, 0, 0}, tilt) * scaling({size, size, size}));
    placed++;
  }

  std::vector<int> tufts;
  const int blades = glb.add_mask("grass", glb.add_texture("grass", grass_blades(256), false));
  for (uint64_t seed : {1, 2, 3}) tufts.push_back(glb.add_mesh("grass", grass_tuft(seed), blades));
  const int num_tufts = scaled(3000, 20);
  for (int placed = 0, tries = 0; placed < num_tufts && tries < 1000000; ++tries) {
    // Thinner with the distance from the eye.
    const double distance = 2.5 + 28 * random.next(), angle = random.range(-0.7, 0.7);
    const double x = eye.x + distance * std::sin(angle), z = eye.z - distance * std::cos(angle);
    const double turn = random.range(0, 2 * pi), scale = random.range(0.7, 1.35);
    if (!is_dry(x, z, 0.3) || fractal_noise({x * 0.22, 9, z * 0.22}, 3, 41) < 0.1) continue;
    glb.place("grass", tufts[size_t(placed % 3)], upright(x, z, 0, turn, scale));
    placed++;
  }

  glb.add_directional_light({0.55, -0.62, -0.56}, {10.5, 9.2, 7.2});
  glb.set_environment({0.75, 1.05, 1.55});
  const Vec3 from{eye.x, land(eye.x, eye.z) + 2.6, eye.z};
  add_scene_camera(glb, options, look_at(from, {-1.5, 0.9, -10}), 0.70, 768, 432);
}

}  // namespace cli::scenes
