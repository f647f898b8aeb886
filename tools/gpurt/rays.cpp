#include "rays.h"

#include <cmath>
#include <limits>

namespace cli {

constexpr float two_pi = 6.28318530717958647692f;
constexpr float infinite = std::numeric_limits<float>::infinity();

Vec operator+(Vec a, Vec b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
Vec operator-(Vec a, Vec b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
Vec operator*(Vec a, float s) { return {a.x * s, a.y * s, a.z * s}; }
float dot(Vec a, Vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
Vec normalize(Vec v) { return v * (1 / std::sqrt(dot(v, v))); }

Vec sphere_direction(Random &random)
{
  const float z = 1 - 2 * random.uniform(), r = std::sqrt(std::max(0.0f, 1 - z * z)),
              phi = two_pi * random.uniform();
  return {r * std::cos(phi), r * std::sin(phi), z};
}

Vec cosine_direction(Vec normal, Random &random)
{
  // The sum of the normal and a point on the unit sphere is distributed so; the one case of length 0 is drawn again.
  for (;;) {
    const Vec d = normal + sphere_direction(random);
    if (dot(d, d) > 1e-6f) return normalize(d);
  }
}

std::vector<gpurt_ray> camera_rays(const gpurt_camera_desc &camera, uint32_t width, uint32_t height)
{
  const float *m = camera.transform;
  const auto column = [&](int c) { return normalize(Vec{m[c], m[4 + c], m[8 + c]}); };
  const Vec x = column(0), y = column(1), z = column(2);
  const float scale = 2 * std::tan(0.5f * camera.yfov_rad) / float(height);
  std::vector<gpurt_ray> rays;
  rays.reserve(uint64_t(width) * height);
  for (uint32_t row = 0; row < height; ++row) {
    for (uint32_t column = 0; column < width; ++column) {
      const float u = (float(column) + 0.5f - 0.5f * float(width)) * scale,
                  v = (0.5f * float(height) - float(row) - 0.5f) * scale;
      const Vec d = normalize(x * u + y * v - z);
      rays.push_back({{m[3], m[7], m[11]}, 0, {d.x, d.y, d.z}, infinite});
    }
  }
  return rays;
}

std::vector<gpurt_ray> random_rays(const gpurt_scene_facts &facts, uint64_t count, Random &random)
{
  std::vector<gpurt_ray> rays(count);
  for (gpurt_ray &ray : rays) {
    for (int c = 0; c < 3; ++c)
      ray.origin[c] = facts.bounds_min[c] + random.uniform() * (facts.bounds_max[c] - facts.bounds_min[c]);
    const Vec d = sphere_direction(random);
    ray.tmin = 0;
    ray.direction[0] = d.x;
    ray.direction[1] = d.y;
    ray.direction[2] = d.z;
    ray.tmax = infinite;
  }
  return rays;
}

}  // namespace cli
