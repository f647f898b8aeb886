#include "scene/emission_table.h"

#include <algorithm>
#include <cmath>

#include "scene/affine.h"

namespace gpurt {

namespace {

constexpr double pi_double = 3.14159265358979323846;

Vec3d world_corner(const CompiledScene &scene, const Light &light, uint32_t vertex)
{
  const Vec3d p = to_double(scene.positions[vertex]);
  if (light.placement == invalid_id) return p;
  return transform_point(to_double(scene.placements[light.placement].object_to_world), p);
}

double triangle_area(const CompiledScene &scene, const Light &light)
{
  const UInt3 corner = scene.indices[light.triangle];
  const Vec3d a = world_corner(scene, light, corner.x);
  return 0.5 *
         length(cross(world_corner(scene, light, corner.y) - a, world_corner(scene, light, corner.z) - a));
}

// Integral of glTF's falloff over the cone, as emission.h samples it.
double spot_solid_angle(const Light &light)
{
  const double width = std::max(0.001, double(light.cos_inner) - light.cos_outer);
  const double rim_end = std::min(light.cos_outer + width, 1.0);
  const double rim_share = (rim_end - light.cos_outer) / width;
  return 2 * pi_double * (1 - rim_end + width * rim_share * rim_share * rim_share / 3);
}

double power(const CompiledScene &scene, const Light &light, double disc_area)
{
  const double color = max_component(light.color);
  switch (light.type) {
    case LightType::Triangle:
      return color * pi_double * triangle_area(scene, light) * (light.two_sided ? 2 : 1);
    case LightType::Point:
      return color * 4 * pi_double;
    case LightType::Spot:
      return color * spot_solid_angle(light);
    case LightType::Distant:
      return color * disc_area;
    case LightType::Environment:
      break;  // it is none of the list
  }
  return 0;
}

double environment_power(const Environment &e, double disc_area)
{
  if (!e.is_present) return 0;
  const double mean = e.row_cdf ? double(e.mean_luminance)
                                : (e.texture == invalid_id ? double(max_component(e.radiance)) : 0.0);
  return mean * 4 * pi_double * disc_area;
}

}  // namespace

EmissionView EmissionTable::view() const
{
  return {cdf.empty() ? nullptr : cdf.data(), cdf.empty() ? 0 : uint32_t(cdf.size() - 1), float(total_weight),
          center, radius};
}

EmissionTable make_emission_table(const CompiledScene &scene)
{
  EmissionTable table;
  if (is_empty(scene.bounds)) return table;
  const Vec3d lo = to_double(scene.bounds.lo), hi = to_double(scene.bounds.hi);
  const Vec3d center = (lo + hi) * 0.5;
  table.center = {float(center.x), float(center.y), float(center.z)};
  // Wider by more than the roundings of the center and of points on the disc.
  table.radius = float(0.5 * length(hi - lo) * (1 + 0x1p-18)) + max_component(abs(table.center)) * 0x1p-22f;
  const double disc_area = pi_double * table.radius * double(table.radius);

  std::vector<double> weights;
  for (const Light &light : scene.lights) weights.push_back(power(scene, light, disc_area));
  weights.push_back(environment_power(scene.view().environment, disc_area));
  double sum = 0;
  for (double &w : weights) {
    if (!std::isfinite(w) || w < 0) w = 0;
    sum += w;
  }
  if (!(sum > 0) || !std::isfinite(float(sum))) return table;
  table.total_weight = sum;
  table.cdf.reserve(weights.size() + 1);
  table.cdf.push_back(0);
  double so_far = 0;
  for (const double w : weights) {
    so_far += w;
    table.cdf.push_back(float(so_far / sum));
  }
  // Rounding must not leave numbers below 1 to a light without power.
  size_t last = weights.size();
  while (last > 0 && !(weights[last - 1] > 0)) --last;
  for (size_t i = last; i < table.cdf.size(); ++i) table.cdf[i] = 1.0f;
  return table;
}

}  // namespace gpurt
