// Small scenes with known answers, for tests.
#include <algorithm>

#include "scenes.h"

namespace cli::scenes {

namespace {

int subdivisions(const SceneOptions &options, int usual)
{
  return std::clamp(usual + int(std::lround(std::log2(options.detail))), 0, 8);
}

}  // namespace

// A closed sphere of radius 1 and albedo 1/2 with a lamp of intensity pi at its centre: seen from inside, every point
// shows radiance 1 with all bounces and 1/2 with direct light alone.
void make_furnace(GlbWriter &glb, const SceneOptions &options)
{
  const int wall = glb.add_lambert("wall", {0.5, 0.5, 0.5});
  glb.place("sphere", glb.add_mesh("sphere", icosphere(subdivisions(options, 5), false), wall));
  glb.add_point_light({0, 0, 0}, {pi, pi, pi});
  add_scene_camera(glb, options, look_at({0, 0, 0.3}, {0, 0, -1}), pi / 2, 128, 128);
}

// A closed sphere of albedo 1/2 under a constant sky of radiance 1: outside shows 1, the sphere 1/2.
void make_icosphere(GlbWriter &glb, const SceneOptions &options)
{
  const int grey = glb.add_lambert("grey", {0.5, 0.5, 0.5});
  glb.place("sphere", glb.add_mesh("sphere", icosphere(subdivisions(options, 4), false), grey));
  glb.set_environment({1, 1, 1});
  add_scene_camera(glb, options, look_at({0, 0, 3}, {0, 0, 0}), 0.8, 128, 128);
}

void add_scene_camera(GlbWriter &glb, const SceneOptions &options, const Matrix &matrix, double yfov_rad,
                      int width, int height)
{
  const double aspect = double(width) / height;
  const int w = options.width    ? options.width
                : options.height ? std::max(1, int(std::lround(options.height * aspect)))
                                 : width;
  const int h = options.height  ? options.height
                : options.width ? std::max(1, int(std::lround(options.width / aspect)))
                                : height;
  glb.add_camera(matrix, yfov_rad, w, h);
}

}  // namespace cli::scenes
