// Photon maps through the C ABI, in one call each, with their answers as vectors.
#pragma once

#include "gpurt_test.h"
#include "photon_sets.h"

namespace gpurt_test {

using PhotonMap = Owned<gpurt_photon_map, gpurt_photon_map_release>;
using photon_sets::Point;

struct MapPoints {
  std::vector<Point> positions, fluxes, normals;
};

inline PhotonMap make_map(gpurt_device device, const MapPoints &points, float radius, uint32_t num_levels = 1)
{
  gpurt_photon_map_desc desc = GPURT_PHOTON_MAP_DESC_INIT;
  desc.num_points = points.positions.size();
  desc.positions = points.positions.data()->data();
  if (!points.fluxes.empty()) desc.fluxes = points.fluxes.data()->data();
  if (!points.normals.empty()) desc.normals = points.normals.data()->data();
  desc.radius = radius;
  desc.num_levels = num_levels;
  PhotonMap map;
  GPURT_EXPECT_OK(gpurt_photon_map_create(device, &desc, map.out()));
  return map;
}

struct Answers {
  std::vector<uint32_t> counts, ids;
  std::vector<Point> sums;
  std::vector<uint64_t> offsets;
  std::vector<float> distances;

  bool operator==(const Answers &other) const
  {
    const auto same = [](const auto &a, const auto &b) {
      return a.size() == b.size() &&
             (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof a[0]) == 0);
    };
    return same(counts, other.counts) && same(ids, other.ids) && same(sums, other.sums) &&
           same(offsets, other.offsets) && same(distances, other.distances);
  }
  /// The ids of one query, sorted.
  std::vector<uint32_t> listed(size_t query) const
  {
    std::vector<uint32_t> part(ids.begin() + ptrdiff_t(offsets[query]),
                               ids.begin() + ptrdiff_t(offsets[query + 1]));
    std::sort(part.begin(), part.end());
    return part;
  }
};

inline gpurt_photon_query_desc query_desc(gpurt_photon_query query, const std::vector<Point> &positions,
                                          float radius)
{
  gpurt_photon_query_desc desc = GPURT_PHOTON_QUERY_DESC_INIT;
  desc.query = query;
  desc.num_queries = positions.size();
  desc.positions = positions.data()->data();
  desc.radius = radius;
  return desc;
}

/// Fills in the arrays of a description in host memory, and asks.
inline Answers ask(gpurt_photon_map map, gpurt_photon_query_desc desc)
{
  Answers a;
  const size_t n = desc.num_queries;
  switch (desc.query) {
    case GPURT_PHOTON_QUERY_SUM:
      a.sums.resize(n);
      desc.sums = a.sums.data()->data();
      [[fallthrough]];
    case GPURT_PHOTON_QUERY_COUNT:
      a.counts.resize(n);
      desc.counts = a.counts.data();
      break;
    case GPURT_PHOTON_QUERY_LIST:
      a.offsets.resize(n + 1);
      desc.offsets = a.offsets.data();
      GPURT_EXPECT_OK(gpurt_photon_map_query(map, &desc));
      a.ids.resize(a.offsets[n]);
      a.distances.resize(a.offsets[n]);
      desc.ids = a.ids.data();
      desc.distances = a.distances.data();
      desc.capacity = a.ids.size();
      break;
    default:
      a.counts.resize(n);
      a.ids.resize(n * desc.k);
      a.distances.resize(n * desc.k);
      desc.counts = a.counts.data();
      desc.ids = a.ids.data();
      desc.distances = a.distances.data();
      break;
  }
  GPURT_EXPECT_OK(gpurt_photon_map_query(map, &desc));
  return a;
}

/// d^2 as gpurt.h defines it.
inline float distance2(const Point &a, const Point &b)
{
  const float x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
  return std::fma(x, x, std::fma(y, y, z * z));
}

inline double exact_distance(const Point &a, const Point &b)
{
  const double x = double(a[0]) - b[0], y = double(a[1]) - b[1], z = double(a[2]) - b[2];
  return std::sqrt(x * x + y * y + z * z);
}

}  // namespace gpurt_test
