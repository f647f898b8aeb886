// Meshes for the device's builder of bvhs: of every class of node sizes, and those on which builders fail.
#pragma once

#include <string_view>

#include "../support/short_form.h"
#include "bvh_check.h"

namespace gpurt::test {

struct NamedMesh {
  const char *name;
  Mesh mesh;
};

/// Each triangle half as large as the last, around one point, `copies` of each.
inline Mesh shrinking(Random &rng, int copies)
{
  Mesh m;
  for (int i = 0; i < 240; ++i) {
    const float s = std::ldexp(1.0f, 110 - i);
    for (int n = 0; n < copies; ++n)
      m.add(Vec3f{s, s, s} * rng.uniform(0.9f, 1.1f), {1.5f * s, s, s}, {s, 1.5f * s, 1.25f * s});
  }
  return m;
}

inline std::vector<NamedMesh> device_meshes()
{
  Random rng(3);
  std::vector<NamedMesh> meshes;
  const auto add = [&](const char *name, const Mesh &mesh) { meshes.push_back({name, mesh}); };
  Mesh one, two, grid, far = soup(rng, 5000, 0.3f, 1), tiny = soup(rng, 500, 0.3f, 1), huge = tiny, alike,
                       flat, star, mixed = soup(rng, 60000, 0.02f, 1), slivers;
  one.add({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
  two = one;
  two.add({1000, 0, 0}, {1001, 0, 0}, {1000, 1, 0});
  for (int i = 0; i < 4000; ++i) {
    const auto g = [&] { return float(int(rng.below(9)) - 4); };
    grid.add({g(), g(), g()}, {g(), g(), g()}, {g(), g(), g()});
  }
  for (Vec3f &p : far.positions) p = p + Vec3f{1e6f, -1e6f, 1e6f};
  for (Vec3f &p : tiny.positions) p = p * 1e-41f;  // denormal numbers
  for (Vec3f &p : huge.positions) p = p * 2.5e38f;
  for (int i = 0; i < 20000; ++i) alike.add({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
  for (int i = 0; i < 30000; ++i) {
    const Vec3f p = {rng.uniform(-1, 1), 0.25f, rng.uniform(-1, 1)};
    flat.add(p, p + Vec3f{0.01f, 0, 0}, p + Vec3f{0, 0, 0.01f});
  }
  for (int i = 0; i < 10000; ++i) star.add({0, 0, 0}, rng.direction(), rng.direction());
  for (int i = 0; i < 3000; ++i) {
    const Vec3f p = rng.point(1), d = rng.direction();
    slivers.add(p, p + d * 1e-3f, p + d * 2.0f + rng.point(1e-6f));
  }
  mixed.add(icosphere(5, 0.5f));
  mixed.add(needles_of(rng, 5000));
  for (int i = 0; i < 1000; ++i) mixed.add({1, 2, 3}, {1, 2, 3}, {1, 2, 3});  // no area
  add("one", one);
  add("two", two);
  add("thirty-two", soup(rng, 32, 0.3f, 1));
  add("thirty-three", soup(rng, 33, 0.3f, 1));
  add("soup", soup(rng, 500, 3, 1));
  add("needles", needles_of(rng, 6000));
  add("slivers", slivers);
  add("grid", grid);
  add("icosphere", icosphere(5, 1));
  add("box", box({-1, -1, -1}, {1, 1, 1}));
  add("sparse", soup(rng, 300, 1e-3f, 1000));
  add("far", far);
  add("tiny", tiny);
  add("huge", huge);
  add("alike", alike);
  add("flat", flat);
  add("star", star);
  add("mixed", mixed);
  add("shrinking", shrinking(rng, 1));
  add("crowded", shrinking(rng, 100));
  if (gpurt_test::is_short_form()) {
    // Those of few and of many triangles, small and large, without area and all alike.
    std::erase_if(meshes, [](const NamedMesh &m) {
      const std::string_view left_out[] = {"two",  "thirty-two", "slivers", "sparse", "far",
                                           "flat", "star",       "huge",    "box",    "crowded"};
      return std::find(std::begin(left_out), std::end(left_out), m.name) != std::end(left_out);
    });
  }
  return meshes;
}

}  // namespace gpurt::test
