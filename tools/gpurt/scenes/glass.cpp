// A table with glass, mirror and metal under a large lamp: refraction, caustics and glossy reflection.
#include <algorithm>

#include "scenes.h"
#include "texture.h"

namespace cli::scenes {

namespace {

using Profile = std::vector<std::array<double, 2>>;

// Rounds the corners of a profile with arcs made of straight pieces.
Profile smoothed(const Profile &points, int steps)
{
  // Catmull-Rom through the points; the ends stand for their missing neighbours.
  Profile out;
  for (size_t i = 0; i + 1 < points.size(); ++i) {
    const auto &p0 = points[i > 0 ? i - 1 : 0], &p1 = points[i], &p2 = points[i + 1],
               &p3 = points[std::min(i + 2, points.size() - 1)];
    for (int s = 0; s < steps; ++s) {
      const double t = double(s) / steps, t2 = t * t, t3 = t2 * t;
      std::array<double, 2> p;
      for (size_t c = 0; c < 2; ++c) {
        p[c] = 0.5 * (2 * p1[c] + (p2[c] - p0[c]) * t + (2 * p0[c] - 5 * p1[c] + 4 * p2[c] - p3[c]) * t2 +
                      (3 * p1[c] - p0[c] - 3 * p2[c] + p3[c]) * t3);
      }
      out.push_back({std::max(p[0], 0.0), p[1]});
    }
  }
  out.push_back(points.back());
  return out;
}

// A goblet: foot, stem and bowl, as a closed solid from the middle of its foot to the middle of the bowl's inside.
Mesh goblet(double detail)
{
  const int steps = std::max(2, int(std::lround(10 * detail)));
  Profile profile = {{0, 0}, {0.28, 0}};
  const auto add = [&](const Profile &part) { profile.insert(profile.end(), part.begin(), part.end()); };
  add(smoothed({{0.285, 0.012},
                {0.20, 0.030},
                {0.07, 0.055},
                {0.033, 0.11},
                {0.027, 0.25},
                {0.036, 0.36},
                {0.12, 0.43},
                {0.225, 0.55},
                {0.255, 0.70},
                {0.225, 0.92}},
               steps));
  add(smoothed({{0.222, 0.928}, {0.218, 0.92}, {0.245, 0.70}, {0.214, 0.555}, {0.11, 0.445}, {0, 0.415}},
               steps));
  return lathe(profile, std::max(12, int(std::lround(128 * detail))));
}

Mesh vase(double detail)
{
  const int steps = std::max(2, int(std::lround(10 * detail)));
  Profile profile = {{0, 0}, {0.16, 0}};
  const auto add = [&](const Profile &part) { profile.insert(profile.end(), part.begin(), part.end()); };
  add(smoothed(
      {{0.17, 0.01}, {0.27, 0.16}, {0.33, 0.36}, {0.27, 0.60}, {0.12, 0.80}, {0.095, 0.92}, {0.14, 1.02}},
      steps));
  add(smoothed({{0.138, 1.025},
                {0.125, 1.02},
                {0.08, 0.92},
                {0.10, 0.80},
                {0.25, 0.59},
                {0.31, 0.36},
                {0.25, 0.16},
                {0, 0.04}},
               steps));
  return lathe(profile, std::max(12, int(std::lround(128 * detail))));
}

}  // namespace

void make_glass(GlbWriter &glb, const SceneOptions &options)
{
  const int wood = glb.add_lambert("wood", {1, 1, 1}, glb.add_texture("wood", wood_planks(1024), true));
  const int wall = glb.add_lambert("wall", {0.36, 0.43, 0.50});
  const int clay = glb.add_lambert("clay", {0.55, 0.22, 0.12});
  const int glass = glb.add_glass("glass", {1, 1, 1});
  const int amber = glb.add_glass("amber", {0.95, 0.55, 0.18});
  const int mirror = glb.add_mirror("mirror", {0.96, 0.96, 0.96});
  const int copper = glb.add_metal("copper", {0.93, 0.62, 0.48}, 0.28);
  const int gold = glb.add_metal("gold", {1.0, 0.78, 0.34}, 0.4);
  const int lamp = glb.add_lamp("lamp", {9.5, 8.6, 7.4});
  const int strip = glb.add_lamp("strip", {4.5, 6, 7.5});

  // The table runs on as a wall without an edge.
  Mesh floor = quad({-5, 0, 4}, {5, 0, 4}, {5, 0, -2.6}, {-5, 0, -2.6});
  for (size_t i = 0; i < 4; ++i) floor.uvs[i] = {floor.positions[i].x / 2, floor.positions[i].z / 2};
  glb.place("floor", glb.add_mesh("floor", floor, wood));
  glb.place("wall",
            glb.add_mesh("wall", quad({-5, 0, -2.6}, {5, 0, -2.6}, {5, 5, -2.6}, {-5, 5, -2.6}), wall));

  const int level = std::clamp(5 + int(std::lround(std::log2(options.detail))), 1, 7);
  const Mesh ball = icosphere(level, true);
  const auto sphere = [&](const char *name, int material, Vec3 center, double radius) {
    glb.place(name, glb.add_mesh(name, ball, material),
              translation(center) * scaling({radius, radius, radius}));
  };
  sphere("glass ball", glass, {-0.95, 0.5, 0.05}, 0.5);
  sphere("mirror ball", mirror, {0.62, 0.48, -0.75}, 0.48);
  sphere("amber ball", amber, {0.22, 0.17, 1.0}, 0.17);
  sphere("gold ball", gold, {-0.42, 0.15, 1.15}, 0.15);
  sphere("little glass ball", glass, {0.62, 0.11, 1.3}, 0.11);

  glb.place("goblet", glb.add_mesh("goblet", goblet(options.detail), glass), translation({-0.12, 0, 0.25}));
  glb.place("vase", glb.add_mesh("vase", vase(options.detail), clay), translation({1.42, 0, -0.35}));
  // A looking-glass in a copper frame leans against the wall.
  const Matrix leaning =
      translation({-0.72, 0, -2.0}) * rotation({0, 1, 0}, 0.22) * rotation({1, 0, 0}, -0.05);
  constexpr double half_width = 1.15, height = 1.5, rim = 0.06, depth = 0.05;
  glb.place("looking-glass",
            glb.add_mesh("looking-glass",
                         quad({-half_width + rim, rim, 0}, {half_width - rim, rim, 0},
                              {half_width - rim, height - rim, 0}, {-half_width + rim, height - rim, 0}),
                         mirror),
            leaning);
  Mesh frame = box({-half_width, 0, -depth}, {half_width, rim, depth});
  frame.append(box({-half_width, height - rim, -depth}, {half_width, height, depth}));
  frame.append(box({-half_width, rim, -depth}, {-half_width + rim, height - rim, depth}));
  frame.append(box({half_width - rim, rim, -depth}, {half_width, height - rim, depth}));
  glb.place("frame", glb.add_mesh("frame", frame, copper), leaning);
  // A glass block.
  glb.place("block", glb.add_mesh("block", box({-0.16, 0, -0.16}, {0.16, 0.32, 0.16}), glass),
            translation({1.02, 0, 0.62}) * rotation({0, 1, 0}, 0.6));

  // Both lamps shine towards the middle of the table.
  const auto place_lamp = [&](const char *name, int material, Vec3 center, double half_width,
                              double half_height) {
    const Matrix m = look_at(center, {0, 0.3, 0});
    const auto corner = [&](double x, double y) {
      return transform_point(m, {x * half_width, y * half_height, 0});
    };
    glb.place(name,
              glb.add_mesh(name, quad(corner(1, -1), corner(-1, -1), corner(-1, 1), corner(1, 1)), material));
  };
  place_lamp("lamp", lamp, {-1.7, 3.6, 1.9}, 1.35, 1.35);
  place_lamp("strip", strip, {3.4, 1.9, 1.0}, 0.5, 1.1);
  glb.set_environment({0.26, 0.30, 0.36});
  add_scene_camera(glb, options, look_at({0.25, 1.75, 4.9}, {0.05, 0.45, -0.1}), 0.50, 640, 480);
}

}  // namespace cli::scenes
