// The Cornell box. Measurements as the Cornell University Program of Computer Graphics published them, in metres;
// colours in linear RGB as commonly derived from the published spectra.
#include "scenes.h"

namespace cli::scenes {

void make_cornell(GlbWriter &glb, const SceneOptions &options)
{
  // Published in millimetres: x to the left, y up, z into the box.
  const auto mm = [](double x, double y, double z) { return Vec3{x * 1e-3, y * 1e-3, z * 1e-3}; };
  const int white = glb.add_lambert("white", {0.725, 0.71, 0.68});
  const int red = glb.add_lambert("red", {0.63, 0.065, 0.05});
  const int green = glb.add_lambert("green", {0.14, 0.45, 0.091});
  const int lamp = glb.add_lamp("lamp", {17, 12, 4});

  const auto wall = [&](const char *name, int material, Vec3 a, Vec3 b, Vec3 c, Vec3 d) {
    glb.place(name, glb.add_mesh(name, quad(a, b, c, d), material));
  };
  wall("floor", white, mm(552.8, 0, 0), mm(0, 0, 0), mm(0, 0, 559.2), mm(549.6, 0, 559.2));
  wall("ceiling", white, mm(556, 548.8, 0), mm(556, 548.8, 559.2), mm(0, 548.8, 559.2), mm(0, 548.8, 0));
  wall("back wall", white, mm(549.6, 0, 559.2), mm(0, 0, 559.2), mm(0, 548.8, 559.2), mm(556, 548.8, 559.2));
  wall("right wall", green, mm(0, 0, 559.2), mm(0, 0, 0), mm(0, 548.8, 0), mm(0, 548.8, 559.2));
  wall("left wall", red, mm(552.8, 0, 0), mm(549.6, 0, 559.2), mm(556, 548.8, 559.2), mm(556, 548.8, 0));
  // The published lamp lies in the plane of the ceiling; a tenth of a millimetre below it the two are not confused.
  wall("lamp", lamp, mm(343, 548.7, 227), mm(343, 548.7, 332), mm(213, 548.7, 332), mm(213, 548.7, 227));

  const auto block = [&](const char *name, double height, std::array<std::array<double, 2>, 4> base) {
    Mesh mesh;
    const auto corner = [&](size_t i, double y) { return mm(base[i % 4][0], y, base[i % 4][1]); };
    mesh.add_quad(corner(0, height), corner(1, height), corner(2, height), corner(3, height));
    for (size_t i = 0; i < 4; ++i)
      mesh.add_quad(corner(i + 1, 0), corner(i + 1, height), corner(i, height), corner(i, 0));
    glb.place(name, glb.add_mesh(name, mesh, white));
  };
  block("short block", 165, {{{130, 65}, {82, 225}, {240, 272}, {290, 114}}});
  block("tall block", 330, {{{423, 247}, {265, 296}, {314, 456}, {472, 406}}});

  // A film of 25 mm behind a lens of 35 mm.
  add_scene_camera(glb, options, look_at(mm(278, 273, -800), mm(278, 273, 0)), 2 * std::atan(12.5 / 35), 512,
                   512);
}

}  // namespace cli::scenes
