#include "frame/photon_settings.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "core/photon/gather_photons.h"
#include "core/photon/photon_wave.h"

namespace gpurt {

namespace {

constexpr uint32_t fewest_photons = 1u << 14;  // of a pass, by default

// Photons of a pass within the initial radius, at the visible points where they are dense: a twentieth of the points has
// as many or more. Caustics want a radius of their own size; points in their neighbourhood then have fewer photons a
// pass, and more passes. In the median instead, the error of caustics at equal time was up to a hundred times larger, and
// that of a box without caustics a third smaller.
constexpr uint32_t photons_in_radius = 10;
constexpr double share_of_points = 0.05;
constexpr uint32_t pilot_photons = 1u << 16;
constexpr uint32_t pilot_points_per_axis = 16;

// The largest radius over the distance between neighbours among the pilot's points, of which 16 lie side by side: discs of
// 1/24 of the picture. What stands on a surface hides its discs from the rays that measure them, and none of the
// estimates of the error tells when discs are larger than what stands there.
constexpr double radius_over_spacing = 1.0 / 3;

// The median distance from a point to the nearest one of the same surface, as far as normals tell; 0: there is none.
double spacing_of(const std::vector<PhotonPilot::Point> &points)
{
  const int threshold = normal_threshold(gather_min_cosine);
  std::vector<double> distances;
  for (const auto &point : points) {
    double nearest = std::numeric_limits<double>::infinity();
    for (const auto &other : points) {
      const double distance2 = double(length2(other.position - point.position));
      // Pixels of small frames are asked twice.
      if (!(distance2 > 0) || normal_dot(point.normal_code, other.normal_code) <= threshold) continue;
      nearest = std::min(nearest, distance2);
    }
    if (std::isfinite(nearest)) distances.push_back(std::sqrt(nearest));
  }
  if (distances.empty()) return 0;
  const auto median = distances.begin() + std::ptrdiff_t(distances.size() / 2);
  std::nth_element(distances.begin(), median, distances.end());
  return *median;
}

void check_equal(const char *name, uint32_t asked, uint32_t made_with)
{
  if (asked == made_with) return;
  fail_invalid("photon.{} is {}, but the frame holds samples made with {}; create a new frame for another",
               name, asked, made_with);
}

}  // namespace

PhotonSettings resolve_photon_settings(const gpurt_photon_settings &asked, const PhotonSettings &made_with,
                                       uint64_t num_pixels)
{
  // But the one that takes rays at every point.
  constexpr uint32_t all_remedies = remedy_normal | remedy_plane | remedy_side | remedy_boundary;
  const uint32_t none = GPURT_PHOTON_REMEDY_NONE;
  if (asked.remedies & ~(all_remedies | remedy_continue | none) ||
      (asked.remedies & none && asked.remedies != none)) {
    fail_invalid("photon.remedies is {:#x}; it is bits of gpurt_photon_remedy, and NONE stands alone",
                 asked.remedies);
  }
  if (asked.reserved != 0) fail_invalid("photon.reserved is {}; it must be 0", asked.reserved);
  if (!(asked.initial_radius >= 0) || std::isinf(asked.initial_radius)) {
    fail_invalid("photon.initial_radius is {}; it must be 0 or a positive number", asked.initial_radius);
  }

  PhotonSettings s;
  s.photons_per_pass = asked.photons_per_pass;
  s.initial_radius = asked.initial_radius;
  s.estimator = PhotonEstimator(asked.estimator);
  s.kernel = PhotonKernel(asked.kernel);
  s.remedies = asked.remedies == none ? 0 : asked.remedies;
  if (made_with.photons_per_pass == 0) {
    if (s.photons_per_pass == 0)
      s.photons_per_pass =
          uint32_t(std::clamp<uint64_t>(std::bit_ceil(num_pixels), fewest_photons, most_default_photons));
    if (asked.kernel == GPURT_PHOTON_KERNEL_AUTO) s.kernel = PhotonKernel::Constant;
    if (asked.remedies == 0) s.remedies = all_remedies;
    if (asked.estimator == GPURT_PHOTON_ESTIMATOR_AUTO) s.estimator = PhotonEstimator::Memoryless;
    if (s.estimator == PhotonEstimator::PerPixel && s.kernel != PhotonKernel::Constant) {
      fail(GPURT_ERROR_UNSUPPORTED,
           "photon.kernel is not supported with GPURT_PHOTON_ESTIMATOR_PER_PIXEL, whose radii shrink by the "
           "number of photons: use GPURT_PHOTON_KERNEL_CONSTANT, or another photon.estimator");
    }
    return s;
  }
  if (s.photons_per_pass != 0)
    check_equal("photons_per_pass", s.photons_per_pass, made_with.photons_per_pass);
  if (asked.estimator != GPURT_PHOTON_ESTIMATOR_AUTO)
    check_equal("estimator", asked.estimator, uint32_t(made_with.estimator));
  if (asked.kernel != GPURT_PHOTON_KERNEL_AUTO)
    check_equal("kernel", asked.kernel, uint32_t(made_with.kernel));
  if (asked.remedies != 0) check_equal("remedies", s.remedies, made_with.remedies);
  if (s.initial_radius != 0 && s.initial_radius != made_with.initial_radius) {
    if (made_with.initial_radius == 0) {
      fail_invalid("photon.initial_radius is {}, but an earlier job of the frame takes it from the scene",
                   s.initial_radius);
    }
    fail_invalid(
        "photon.initial_radius is {}, but the frame holds samples made with {}; create a new frame for "
        "another",
        s.initial_radius, made_with.initial_radius);
  }
  return made_with;
}

InitialRadius choose_initial_radius(const CommittedScene &scene, const PathSettings &path,
                                    const EmissionView &emission, uint32_t photons_per_pass)
{
  // Where nothing is gathered any radius does.
  const float largest = emission.radius > 0 ? emission.radius : 1.0f;
  if (!emission.cdf) return {largest * 0x1p-7f, largest};
  // A large pass stands for several of the pilot's size, whose radii would have fallen as the cube root of their number: it
  // gets the radius that they end with. The pilot's photons are denser or sparser than those of the pass that the radius is
  // for: an area that has n of the pass has this many of the pilot. At least one photon tells a distance.
  const double share = double(photons_per_pass) / pilot_photons;
  const double ratio = share > 1 ? 1 / cube_root_of(share) : 1 / share;
  const double wanted = std::max(1.0, photons_in_radius * ratio);
  const uint64_t k = uint64_t(std::min(wanted, 4096.0));
  const double scale = std::sqrt(photons_in_radius * ratio / double(k));
  const int threshold = normal_threshold(gather_min_cosine);
  std::vector<std::vector<float>> nearest_of;  // squares of the k smallest distances, a heap for each point
  const auto take = [&](std::span<const PhotonPilot::Point> points, std::span<const Photon> photons) {
    nearest_of.resize(points.size());
    tbb::parallel_for(size_t(0), points.size(), [&](size_t i) {
      const PhotonPilot::Point &point = points[i];
      std::vector<float> &nearest = nearest_of[i];
      for (const Photon &photon : photons) {
        const float distance2 = length2(photon.position - point.position);
        if (nearest.size() == k && !(distance2 < nearest.front())) continue;
        if (normal_dot(point.normal_code, photon.normal) <= threshold) continue;
        if (nearest.size() == k) {
          std::pop_heap(nearest.begin(), nearest.end());
          nearest.pop_back();
        }
        nearest.push_back(distance2);
        std::push_heap(nearest.begin(), nearest.end());
      }
    });
  };
  const PhotonPilot pilot = scene.photon_pilot(path, emission, pilot_photons, pilot_points_per_axis, take);
  std::vector<float> radii;
  for (const std::vector<float> &nearest : nearest_of) {
    if (nearest.size() == k) radii.push_back(float(scale * std::sqrt(double(nearest.front()))));
  }
  const double spacing = spacing_of(pilot.points);
  const float widest = spacing > 0 ? std::min(float(radius_over_spacing * spacing), largest) : largest;
  if (radii.empty())
    return {std::min(largest * (pilot.num_photons == 0 ? 0x1p-7f : 0x1p-3f), widest), widest};
  const auto chosen = radii.begin() + std::ptrdiff_t(share_of_points * double(radii.size()));
  std::nth_element(radii.begin(), chosen, radii.end());
  return {std::clamp(std::min(*chosen, widest), largest * 0x1p-20f, largest), widest};
}

}  // namespace gpurt
