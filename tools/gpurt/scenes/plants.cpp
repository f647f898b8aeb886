// Trees, grass and flowers: branches made of tubes, leaves of cards with alpha masks.
#include "plants.h"

#include <algorithm>

namespace cli::scenes {

namespace {

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

}  // namespace

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

Mesh flower_tuft(uint64_t seed)
{
  Mesh mesh;
  Sequence random(seed);
  for (int k = 0; k < 3; ++k) {
    const double angle = random.range(0, pi), size = random.range(0.22, 0.34);
    const Vec3 side = Vec3{std::cos(angle), 0, std::sin(angle)} * (0.5 * size);
    const Vec3 foot{random.range(-0.2, 0.2), -0.03, random.range(-0.2, 0.2)};
    add_card(mesh, foot, Vec3{random.range(-0.1, 0.1), 1, random.range(-0.1, 0.1)} * size, side);
  }
  return mesh;
}

}  // namespace cli::scenes
