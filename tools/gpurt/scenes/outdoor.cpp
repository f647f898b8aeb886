// A valley with a pond, trees, grass and rocks under sun and sky: about a million triangles, most of them instanced,
// alpha masks on leaves.
#include <algorithm>

#include "plants.h"
#include "scenes.h"
#include "sky.h"
#include "texture.h"

namespace cli::scenes {

namespace {

constexpr double half_size = 90;  // of the land, metres
constexpr double water_level = -1.1;
constexpr Vec3 pond{-5, 0, -6};
constexpr Vec3 eye{5, 0, 20};

double pond_distance(double x, double z) { return std::hypot((x - pond.x) / 17, (z - pond.z) / 11); }

double land(double x, double z)
{
  const double r = std::hypot(x, z);
  const double rolling = 1.5 * fractal_noise({x * 0.035, 0.5, z * 0.035}, 4, 1) +
                         0.06 * fractal_noise({x * 0.6, 1.5, z * 0.6}, 3, 7);
  // Hills close the view; the ridge is rougher than the slopes.
  const double ridge = 1 + 0.55 * fractal_noise({x * 0.03, 2.5, z * 0.03}, 5, 3);
  const double hills = 19 * smooth_step(38, 88, r) * std::max(ridge, 0.2);
  const double basin = -3.2 * (1 - smooth_step(0.45, 1.25, pond_distance(x, z)));
  return rolling + hills + basin;
}

// A square of the land.
struct Area {
  double center_x, center_z, half;
  bool contains(double x, double z) const
  {
    return std::abs(x - center_x) < half && std::abs(z - center_z) < half;
  }
};

// `y` and `slope` are those of the land there.
Vec3 land_color(double x, double z, double y, double slope)
{
  const double n = fractal_noise({x * 0.25, 0.3, z * 0.25}, 4, 21),
               fine = fractal_noise({x * 2.1, 0.7, z * 2.1}, 5, 23);
  Vec3 color = mix({0.055, 0.085, 0.020}, {0.115, 0.125, 0.036}, smooth_step(-0.6, 0.7, n + 0.5 * fine));
  color =
      mix(color, {0.145, 0.105, 0.062},
          smooth_step(0.30, 0.60, n + 0.35 * fine + 0.5 * noise({x * 0.05, 0, z * 0.05}, 31)));  // bare earth
  color = mix(color, Vec3{0.24, 0.225, 0.20} * (0.85 + 0.4 * n + 0.35 * fine),
              smooth_step(0.80, 1.15, slope + 0.25 * n + 0.2 * fine));  // rock
  color = mix(color, {0.20, 0.165, 0.105},
              1 - smooth_step(water_level + 0.1, water_level + 0.55, y + 0.1 * n));  // shore
  // Pebbles on the shore.
  const double pebble = noise({x * 7, 0.1, z * 7}, 51);
  if (y < water_level + 0.5) color = color * (1 + 0.5 * smooth_step(0.25, 0.4, pebble));
  return color * std::max(1 + 0.45 * fine, 0.3);
}

std::vector<uint8_t> land_image(const Area &area, int size)
{
  const double step = 2 * area.half / size;
  const auto x_of = [&](double i) { return area.center_x + (i + 0.5) * step - area.half; };
  const auto z_of = [&](double j) { return area.center_z + (j + 0.5) * step - area.half; };
  // Slopes are those over 40 cm.
  std::vector<double> heights;
  for (int j = 0; j < size; ++j) {
    for (int i = 0; i < size; ++i) heights.push_back(land(x_of(i), z_of(j)));
  }
  const auto height = [&](int i, int j) {
    return heights[size_t(std::clamp(j, 0, size - 1)) * size_t(size) + size_t(std::clamp(i, 0, size - 1))];
  };
  return make_png(size, size, false, [&](double u, double v) {
    const int i = int(u * size), j = int(v * size), reach = std::max(1, int(0.4 / step));
    const double slope =
        std::hypot(height(i + reach, j) - height(i - reach, j), height(i, j + reach) - height(i, j - reach)) /
        (2 * reach * step);
    return Texel{land_color(x_of(i), z_of(j), height(i, j), slope)};
  });
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

// The pond's surface, with ripples; the land hides its rim.
Mesh water(int n)
{
  Mesh mesh = height_field(pond.x - 26, pond.z - 18, pond.x + 26, pond.z + 18, n, [](double x, double z) {
    return water_level + 0.012 * fractal_noise({x * 0.7, 0.2, z * 1.9}, 3, 61);
  });
  mesh.uvs.clear();
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

  // Land: a coarse texture on all of it, and a fine one around the eye, on whole cells of the mesh.
  const int num_cells = scaled(400, 16);
  const double cell = 2 * half_size / num_cells;
  const Area far{0, 0, half_size}, near{0, 0, std::round(22.5 / cell) * cell};
  const Mesh ground = height_field(-half_size, -half_size, half_size, half_size, num_cells, land);
  // A cell belongs where its corner of lowest coordinates lies.
  const auto is_near = [&](Vec3 p) { return near.contains(p.x + 0.5 * cell, p.z + 0.5 * cell); };
  const Mesh far_ground = part_of(ground, [&](Vec3 p) { return !is_near(p); });
  Mesh near_ground = part_of(ground, is_near);
  for (size_t i = 0; i < near_ground.positions.size(); ++i) {
    const Vec3 p = near_ground.positions[i];
    near_ground.uvs[i] = {0.5 + 0.5 * p.x / near.half, 0.5 + 0.5 * p.z / near.half};
  }
  const int far_texture =
      glb.add_texture("land", land_image(far, std::clamp(scaled(1024, 64), 64, 2048)), false);
  const int near_texture =
      glb.add_texture("near land", land_image(near, std::clamp(scaled(1536, 64), 64, 2048)), false);
  glb.place("land",
            glb.add_mesh("land", {{&far_ground, glb.add_lambert("land", {1, 1, 1}, far_texture)},
                                  {&near_ground, glb.add_lambert("near land", {1, 1, 1}, near_texture)}}));
  // Deep and dark water sends back what its surface reflects, 2 % straight on and all at grazing angles.
  glb.place("pond",
            glb.add_mesh("pond", water(scaled(160, 8)), glb.add_metal("water", {0.02, 0.024, 0.024}, 0.06)));

  // Trees: each kind is stored twice, and once with fewer twigs for the forest on the hills, and placed many times.
  const int bark_material = glb.add_lambert("bark", {1, 1, 1}, glb.add_texture("bark", bark(256), true));
  const int leaf_material = glb.add_mask("leaves", glb.add_texture("leaves", leaf_twig(256), false));
  const int needle_material = glb.add_mask("needles", glb.add_texture("needles", needle_twig(256), false));
  const double tree_detail = std::max(detail, 0.2);
  const auto add_tree = [&](const char *name, const Tree &tree, int leaves) {
    return glb.add_mesh(name, {{&tree.wood, bark_material}, {&tree.leaves, leaves}});
  };
  std::vector<int> broad, fir;
  for (uint64_t seed : {1, 2})
    broad.push_back(add_tree("broad-leaved tree", broad_leaved_tree(seed, 9, tree_detail), leaf_material));
  for (uint64_t seed : {3, 4})
    fir.push_back(add_tree("fir", fir_tree(seed, 12, tree_detail), needle_material));
  const int far_fir = add_tree("far fir", fir_tree(5, 12, 0.55 * tree_detail), needle_material);
  const int far_broad = add_tree("far tree", broad_leaved_tree(6, 9, 0.5 * tree_detail), leaf_material);
  Sequence random(2009);
  // A few stand where they frame the view, the others by chance, denser up the hills.
  glb.place("tree", broad[0], upright(14.5, 2.0, 0, 0.4, 1.25));
  glb.place("tree", broad[1], upright(-19.5, -4.0, 0, 2.0, 1.15));
  glb.place("tree", fir[0], upright(10.5, -24.0, 0, 1.0, 1.1));
  glb.place("tree", fir[1], upright(-24.0, -20.0, 0, 4.0, 1.2));
  glb.place("tree", fir[0], upright(-21.5, -24.0, 0, 2.5, 0.8));
  const int num_trees = scaled(190, 4);
  for (int placed = 0, tries = 0; placed < num_trees && tries < 100000; ++tries) {
    const double x = random.range(-84, 84), z = random.range(-84, 40), r = std::hypot(x, z);
    const double chance = random.next(), scale = random.range(0.7, 1.35), turn = random.range(0, 2 * pi);
    const bool in_view = std::abs(x - eye.x) < 9 && z > -12;
    if (!is_dry(x, z, 0.5) || in_view || pond_distance(x, z) < 1.35 || chance > smooth_step(10, 60, r))
      continue;
    const bool is_far = std::hypot(x - eye.x, z - eye.z) > 55;
    const bool is_fir =
        fractal_noise({x * 0.03, 4, z * 0.03}, 2, 77) + 0.012 * (r - 40) + random.range(-0.3, 0.3) > 0;
    const auto &kind = is_fir ? fir : broad;
    const int tree = is_far ? (is_fir ? far_fir : far_broad) : kind[size_t(placed % 2)];
    glb.place("tree", tree, upright(x, z, 0.05, turn, scale));
    placed++;
  }

  std::vector<int> rocks;
  const int stone = glb.add_lambert("stone", {0.20, 0.19, 0.175});
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

  std::vector<int> tufts, blossoms;
  const int blades = glb.add_mask("grass", glb.add_texture("grass", grass_blades(256), false));
  const int petals = glb.add_mask("flowers", glb.add_texture("flowers", flowers(256), false));
  for (uint64_t seed : {1, 2, 3}) tufts.push_back(glb.add_mesh("grass", grass_tuft(seed), blades));
  for (uint64_t seed : {1, 2}) blossoms.push_back(glb.add_mesh("flowers", flower_tuft(seed), petals));
  const int num_tufts = scaled(6500, 20);
  for (int placed = 0, tries = 0; placed < num_tufts && tries < 1000000; ++tries) {
    // Thinner with the distance from the eye.
    const double distance = 2.2 + 30 * std::pow(random.next(), 1.3), angle = random.range(-0.75, 0.75);
    const double x = eye.x + distance * std::sin(angle), z = eye.z - distance * std::cos(angle);
    const double turn = random.range(0, 2 * pi), scale = random.range(0.7, 1.3), chance = random.next();
    if (!is_dry(x, z, 0.35)) continue;
    // Meadows of long grass with short grass between them.
    const double growth = smooth_step(-0.25, 0.35, fractal_noise({x * 0.22, 9, z * 0.22}, 3, 41));
    if (chance > 0.35 + 0.65 * growth) continue;
    const bool has_flowers = placed % 16 == 0 && growth > 0.2;
    glb.place(has_flowers ? "flowers" : "grass",
              has_flowers ? blossoms[size_t(placed / 16 % 2)] : tufts[size_t(placed % 3)],
              upright(x, z, 0, turn, scale * (0.35 + 0.75 * growth)));
    placed++;
  }

  const Vec3 to_sun = normalize({-0.72, 0.62, 0.42});
  glb.add_directional_light(to_sun * -1, {15, 12.9, 9.8});
  glb.set_environment(options.stem + "_sky.hdr", make_sky(1024, 512, to_sun));
  const Vec3 from{eye.x, land(eye.x, eye.z) + 2.6, eye.z};
  add_scene_camera(glb, options, look_at(from, {-1.5, 1.6, -10}), 0.70, 768, 432);
}

}  // namespace cli::scenes
