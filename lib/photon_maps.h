// What a photon map is to the rest of the library, and what a backend that makes them offers.
#pragma once

#include <memory>

#include "core/photon/emission.h"
#include "core/photon/map_query.h"
#include "core/photon/photon_source.h"
#include "error.h"

namespace gpurt {

enum class PhotonQueryKind : uint32_t { Count = 0, Sum = 1, List = 2, Nearest = 3 };  // of gpurt_photon_query
enum class GatherMethod : uint32_t { Grid = 0, NodeLists = 1 };  // of gpurt_gather_method

/// What a map is made from.
struct PhotonMapRequest {
  PhotonSource source;
  bool device_memory = false;  // where the source's arrays lie
  bool has_fluxes = false, has_normals = false;
  float radius = 0;  // 0: chosen
  uint32_t num_levels = 1;
  float flux_scale = 1;  // what sums of fluxes are multiplied with
  uint32_t num_paths =
      0;  // photon paths that the points are of; 0: points of the caller's, without directions
};

/// Photons of a scene for a map: those of one pass of photon mapping.
struct ScenePhotonRequest {
  uint32_t num_paths;
  uint64_t pass;
  float radius;  // 0: chosen
  uint32_t num_levels;
};

/// What the photons of a scene become a map with. Throws where a map cannot hold them.
inline PhotonMapRequest map_request(const ScenePhotonRequest &asked, const EmissionView &emission,
                                    const Photon *records, uint64_t num_photons)
{
  if (num_photons > max_photons) {
    fail(GPURT_ERROR_OUT_OF_MEMORY,
         "{} paths leave {} photons, and a map holds at most {}; emit fewer num_paths", asked.num_paths,
         num_photons, max_photons);
  }
  PhotonMapRequest request;
  request.source = {records, nullptr, nullptr, nullptr, num_photons};
  request.has_fluxes = request.has_normals = true;
  request.radius = asked.radius;
  request.num_levels = asked.num_levels;
  request.flux_scale = float(double(emission.total_weight) / asked.num_paths);
  request.num_paths = asked.num_paths;
  return request;
}

struct PhotonMapFacts {
  uint64_t num_points = 0;
  Box bounds;  // of no points: empty
  float radius = 0;
  uint32_t num_levels = 1;
  bool has_fluxes = false, has_normals = false;
  uint32_t fullest_cell = 0;
  uint64_t bytes = 0;
  double build_seconds = 0;
  float flux_scale = 1;
  uint32_t num_paths = 0;
};

/// What follows from the request and the points' bounds alone.
inline PhotonMapFacts facts_of(const PhotonMapRequest &request, const Box &bounds)
{
  PhotonMapFacts facts;
  facts.num_points = request.source.num_photons;
  facts.bounds = bounds;
  facts.radius = request.radius;
  facts.num_levels = request.num_levels;
  facts.has_fluxes = request.has_fluxes;
  facts.has_normals = request.has_normals;
  facts.flux_scale = request.flux_scale;
  facts.num_paths = request.num_paths;
  return facts;
}

/// gpurt_photon_query_desc after validation.
struct PhotonQuery {
  PhotonQueryKind kind = PhotonQueryKind::Count;
  GatherMethod method = GatherMethod::Grid;
  bool device_memory = false, is_coherent = false;
  uint64_t num_queries = 0;
  const Vec3f *positions = nullptr, *normals = nullptr;
  RangeQuery range{};
  float limit = infinity, hint = 0;  // Nearest
  uint32_t k = 0;
  uint32_t *counts = nullptr;
  Vec3f *sums = nullptr;
  uint64_t *offsets = nullptr;
  uint32_t *ids = nullptr;
  float *distances = nullptr;
  uint64_t capacity = 0;
};

/// Immutable but for what queries keep for later ones. Used from any thread.
class PhotonMap {
 public:
  virtual ~PhotonMap() = default;
  virtual const PhotonMapFacts &facts() const = 0;
  virtual void query(const PhotonQuery &query) const = 0;
  /// The points as records [num_points] in host memory, in the order of their ids.
  virtual void read(Photon *records) const = 0;
};

/// What a map may offer beside PhotonMap: queries that are queued on the caller's stream, as StreamTracing has them.
class StreamQueries {
 public:
  virtual ~StreamQueries() = default;
  virtual void query_on_stream(const PhotonQuery &query, void *stream, void *wait_event,
                               void *done_event) const = 0;
};

/// What a backend may offer beside Backend.
class PhotonMaps {
 public:
  virtual ~PhotonMaps() = default;
  virtual std::shared_ptr<const PhotonMap> make_photon_map(const PhotonMapRequest &request) = 0;
};

/// What looking through all points of a request finds.
struct PointsFound {
  Box bounds;
  uint64_t bad_position, bad_flux, bad_normal;  // the first index; none: UINT64_MAX
};

/// Throws INVALID_ARGUMENT for points that are not allowed.
inline void check_points(const PointsFound &found)
{
  if (found.bad_position != UINT64_MAX) fail_invalid("positions[{}] is not finite", found.bad_position);
  if (found.bad_flux != UINT64_MAX)
    fail_invalid("fluxes[{}] is negative, larger than 3.3e38, or not a number", found.bad_flux);
  if (found.bad_normal != UINT64_MAX) fail_invalid("normals[{}] is not finite", found.bad_normal);
  // Half of the largest float: differences of coordinates, and of a query's, stay in range.
  if (!is_empty(found.bounds) && !is_finite(found.bounds.hi - found.bounds.lo)) {
    fail_invalid("positions reach from {:g} to {:g}, and their differences are no floats; scale them",
                 min_component(found.bounds.lo), max_component(found.bounds.hi));
  }
}

/// Throws INVALID_ARGUMENT where the lists of a query, written or not, had no room.
inline void check_capacity(const PhotonQuery &query, uint64_t total)
{
  if ((query.ids != nullptr || query.distances != nullptr) && total > query.capacity) {
    fail_invalid(
        "the queries find {} points, but capacity is {}; make ids and distances larger, offsets tell how "
        "large",
        total, query.capacity);
  }
}

/// A radius that holds about 50 points where points are dense. `crowd(radius)` tells how many points there are, in the
/// mean over all points, in a point's own cell of that size.
template <class Crowd>
float choose_radius(const Box &bounds, uint64_t num_points, Crowd &&crowd)
{
  if (is_empty(bounds) || !(max_component(bounds.hi - bounds.lo) > 0.0f)) return 1.0f;
  const Vec3f extent = bounds.hi - bounds.lo;
  // Cells of 12 points: a ball holds 50 of them in space and 38 on a plane.
  constexpr double wanted = 12;
  const auto share = [&](float e, float radius) { return e > radius ? double(radius) / double(e) : 1.0; };
  float radius = max_component(extent);
  while (double(num_points) * share(extent.x, radius) * share(extent.y, radius) * share(extent.z, radius) >
         2 * wanted)
    radius *= 0.5f;
  for (int i = 0; i < 8; ++i) {
    const double found = crowd(radius);
    if (found < 1.5 * wanted && found * 1.5 > wanted) break;
    const double ratio = sqrt(wanted / found);  // as on a surface
    radius = max(radius * float(ratio < 0.125 ? 0.125 : (ratio > 8 ? 8 : ratio)),
                 max_component(extent) * 0x1p-20f);
    if (radius >= max_component(extent)) return max_component(extent);
  }
  return radius;
}

}  // namespace gpurt
