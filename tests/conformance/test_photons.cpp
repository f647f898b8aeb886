// Photon maps against brute force and CGAL: what is within a radius, sums over it, and the nearest points, on sets that
// grids meet and on degenerate ones; the same bits for any number of threads and on both backends.
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Fuzzy_sphere.h>
#include <CGAL/Orthogonal_k_neighbor_search.h>
#include <CGAL/Search_traits_3.h>
#include <CGAL/Search_traits_adapter.h>
#include <CGAL/property_map.h>

#include <cstdio>
#include <fstream>
#include <limits>
#include <numeric>
#include <thread>

#include "../support/photon_map.h"
#include "../support/short_form.h"

namespace {

using namespace gpurt_test;
using photon_sets::Set;

constexpr float inf = std::numeric_limits<float>::infinity();
#if defined(__SANITIZE_ADDRESS__)
constexpr size_t num_points = 500, num_queries = 40;
#else
constexpr size_t num_points = 2000, num_queries = 150;
#endif

// A set with fluxes that 8 bits hold, so that they are kept as they are, and unit normals.
MapPoints with_payload(const Set &set)
{
  MapPoints points{set.points, {}, {}};
  std::mt19937 random(11);
  for (size_t i = 0; i < set.points.size(); ++i) {
    points.fluxes.push_back({float(random() % 128 + 128), float(random() % 256), float(random() % 256)});
    points.normals.push_back(photon_sets::on_sphere(random, {0, 0, 0}, 1));
  }
  return points;
}

class Photons : public testing::TestWithParam<gpurt_device_type> {
 protected:
  void SetUp() override
  {
    if (GetParam() == GPURT_DEVICE_CUDA && !has_cuda()) GTEST_SKIP() << "no CUDA device";
    device_ = make_device(GetParam());
    // What the answers are compared with, bit by bit: one thread of the CPU.
    reference_ = make_device(GPURT_DEVICE_CPU, 1);
  }

  // Asks the map, and one of the same points on the reference device.
  Answers ask_both(const MapPoints &points, float radius, uint32_t num_levels,
                   const gpurt_photon_query_desc &desc)
  {
    const PhotonMap map = make_map(device_, points, radius, num_levels);
    const PhotonMap reference = make_map(reference_, points, radius, num_levels);
    Answers answers = ask(map, desc);
    EXPECT_TRUE(answers == ask(reference, desc)) << "bits differ";
    return answers;
  }

  Device device_, reference_;
};

TEST_P(Photons, WithinARadiusAreThoseOfBruteForce)
{
  for (const Set &set : photon_sets::all(num_points)) {
    const std::vector<Point> places = photon_sets::queries(set, num_queries, 5);
    for (const uint32_t num_levels : {1u, 3u}) {
      // Radii that the map was made for, and others.
      for (const float scale : {1.0f, 0.2f, 7.0f}) {
        const float radius = set.radius * scale;
        const MapPoints points{set.points, {}, {}};
        const Answers counts =
            ask_both(points, set.radius, num_levels, query_desc(GPURT_PHOTON_QUERY_COUNT, places, radius));
        const Answers lists =
            ask_both(points, set.radius, num_levels, query_desc(GPURT_PHOTON_QUERY_LIST, places, radius));
        for (size_t q = 0; q < places.size(); ++q) {
          std::vector<uint32_t> expected;
          for (size_t i = 0; i < set.points.size(); ++i) {
            const bool is_within = distance2(set.points[i], places[q]) < radius * radius;
            if (is_within) expected.push_back(uint32_t(i));
            // Three differences, squares and sums of single precision: 2^-22 of the distance and less.
            const double exact = exact_distance(set.points[i], places[q]);
            if (std::abs(exact - radius) > radius * 0x1p-21) {
              ASSERT_EQ(is_within, exact < radius) << set.name;
            }
          }
          ASSERT_EQ(lists.listed(q), expected)
              << set.name << ", levels " << num_levels << ", scale " << scale;
          ASSERT_EQ(counts.counts[q], expected.size()) << set.name;
          for (uint64_t at = lists.offsets[q]; at < lists.offsets[q + 1]; ++at)
            ASSERT_EQ(lists.distances[at], std::sqrt(distance2(set.points[lists.ids[at]], places[q])));
        }
      }
    }
  }
}

TEST_P(Photons, SumsAreThoseOfBruteForce)
{
  for (const Set &set : photon_sets::all(num_points)) {
    const std::vector<Point> places = photon_sets::queries(set, num_queries, 6);
    const MapPoints points = with_payload(set);
    std::vector<Point> normals;
    std::mt19937 random(3);
    for (size_t q = 0; q < places.size(); ++q)
      normals.push_back(photon_sets::on_sphere(random, {0, 0, 0}, 2));
    for (const bool has_normals : {false, true}) {
      for (const gpurt_gather_kernel kernel :
           {GPURT_GATHER_KERNEL_CONSTANT, GPURT_GATHER_KERNEL_CONE, GPURT_GATHER_KERNEL_QUADRATIC}) {
        gpurt_photon_query_desc desc = query_desc(GPURT_PHOTON_QUERY_SUM, places, set.radius);
        desc.kernel = kernel;
        if (has_normals) {
          desc.normals = normals.data()->data();
          desc.min_cosine = 0.3f;
        }
        const Answers answers = ask_both(points, set.radius, 2, desc);
        for (size_t q = 0; q < places.size(); ++q) {
          double sum[3] = {0, 0, 0}, undecided[3] = {0, 0, 0};
          size_t least = 0, most = 0;
          for (size_t i = 0; i < set.points.size(); ++i) {
            const float d2 = distance2(set.points[i], places[q]);
            if (!(d2 < set.radius * set.radius)) continue;
            const double d = std::sqrt(double(d2)) / set.radius;
            const double weight = kernel == GPURT_GATHER_KERNEL_CONSTANT ? 1
                                  : kernel == GPURT_GATHER_KERNEL_CONE   ? 1 - d
                                                                         : 1 - d * d;
            bool counts = true, is_close = false;
            if (has_normals) {
              double dot = 0;
              for (int k = 0; k < 3; ++k) dot += double(points.normals[i][k]) * normals[q][k] / 2;
              counts = dot > 0.3;
              // Both normals are in steps of 1/127: half a step in each component is sqrt(3) / 254 of length.
              is_close = std::abs(dot - 0.3) < 0.0141;
            }
            most += counts || is_close;
            least += counts && !is_close;
            for (int k = 0; k < 3; ++k) {
              const double flux = weight * points.fluxes[i][k];
              if (is_close) undecided[k] += flux;
              else if (counts) sum[k] += flux;
            }
          }
          ASSERT_GE(answers.counts[q], least);
          ASSERT_LE(answers.counts[q], most);
          for (int k = 0; k < 3; ++k) {
            // n additions of single precision, of weights off by 2^-20 of 1.
            const double bound = (double(most) * 0x1p-24 + 0x1p-20) * 256.0 * double(most);
            ASSERT_GE(answers.sums[q][k], sum[k] - bound) << set.name;
            ASSERT_LE(answers.sums[q][k], sum[k] + undecided[k] + bound) << set.name;
          }
        }
      }
    }
  }
}

TEST_P(Photons, NearestAreThoseOfBruteForce)
{
  for (const Set &set : photon_sets::all(num_points)) {
    std::vector<Point> places = photon_sets::queries(set, num_queries, 7);
    places.push_back({NAN, 0, 0});
    places.push_back({0, inf, 0});
    const MapPoints points{set.points, {}, {}};
    for (const uint32_t num_levels : {1u, 4u}) {
      for (const uint32_t k : {1u, 7u, 50u, 200u}) {
        if (k == 200 && num_levels == 1) continue;
        if (is_short_form() && (num_levels == 1) != (k == 7)) continue;
        for (const float limit : {0.0f, set.radius * 1.5f}) {
          if (is_short_form() && (limit == 0) != (k == 1 || k == 200)) continue;
          gpurt_photon_query_desc desc = query_desc(GPURT_PHOTON_QUERY_NEAREST, places, limit);
          desc.k = k;
          desc.radius_hint = k == 7 ? set.radius * 0.1f : 0;
          const Answers answers = ask_both(points, set.radius, num_levels, desc);
          for (size_t q = 0; q < places.size(); ++q) {
            std::vector<std::pair<float, uint32_t>> expected;
            for (size_t i = 0; i < set.points.size(); ++i) {
              const float d2 = distance2(set.points[i], places[q]);
              if (limit == 0 ? d2 < inf : d2 < limit * limit) expected.emplace_back(d2, uint32_t(i));
            }
            const size_t found = std::min<size_t>(k, expected.size());
            std::partial_sort(expected.begin(), expected.begin() + ptrdiff_t(found), expected.end());
            ASSERT_EQ(answers.counts[q], found)
                << set.name << ", k " << k << ", levels " << num_levels << ", limit " << limit;
            for (size_t j = 0; j < k; ++j) {
              ASSERT_EQ(answers.ids[q * k + j], j < found ? expected[j].second : GPURT_INVALID_ID)
                  << set.name;
              ASSERT_EQ(answers.distances[q * k + j], j < found ? std::sqrt(expected[j].first) : inf);
            }
          }
        }
      }
    }
  }
}

namespace exact {
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Indexed = std::pair<Kernel::Point_3, uint32_t>;
using Traits = CGAL::Search_traits_adapter<Indexed, CGAL::First_of_pair_property_map<Indexed>,
                                           CGAL::Search_traits_3<Kernel>>;
using Search = CGAL::Orthogonal_k_neighbor_search<Traits>;
using Tree = Search::Tree;
using Sphere = CGAL::Fuzzy_sphere<Traits>;
Kernel::Point_3 point(const Point &p) { return {p[0], p[1], p[2]}; }
}  // namespace exact

TEST_P(Photons, AgreeWithCgal)
{
  for (const Set &set : photon_sets::all(20000)) {
    if (set.name == "radius larger than the set" || set.name == "all in one point")
      continue;  // every point each time
    const std::vector<Point> places = photon_sets::queries(set, 200, 8);
    exact::Tree tree;
    for (size_t i = 0; i < set.points.size(); ++i) tree.insert({exact::point(set.points[i]), uint32_t(i)});
    tree.build();
    const MapPoints points{set.points, {}, {}};
    const Answers lists =
        ask_both(points, set.radius, 1, query_desc(GPURT_PHOTON_QUERY_LIST, places, set.radius));
    gpurt_photon_query_desc desc = query_desc(GPURT_PHOTON_QUERY_NEAREST, places, 0);
    desc.k = 20;
    const Answers nearest = ask_both(points, set.radius, 3, desc);
    for (size_t q = 0; q < places.size(); ++q) {
      std::vector<exact::Indexed> found;
      tree.search(std::back_inserter(found), exact::Sphere(exact::point(places[q]), double(set.radius)));
      std::vector<uint32_t> expected;
      for (const auto &f : found) expected.push_back(f.second);
      std::sort(expected.begin(), expected.end());
      std::vector<uint32_t> differ;
      const std::vector<uint32_t> listed = lists.listed(q);
      std::set_symmetric_difference(listed.begin(), listed.end(), expected.begin(), expected.end(),
                                    std::back_inserter(differ));
      for (const uint32_t id : differ) {
        // Only where the distance is within rounding of the radius.
        ASSERT_NEAR(exact_distance(set.points[id], places[q]), set.radius, set.radius * 0x1p-21) << set.name;
      }
      exact::Search search(tree, exact::point(places[q]), desc.k);
      size_t j = 0;
      for (const auto &neighbour : search) {
        const double d = std::sqrt(neighbour.second);
        ASSERT_NEAR(nearest.distances[q * desc.k + j], d, d * 0x1p-21) << set.name;
        ++j;
      }
      ASSERT_EQ(nearest.counts[q], j);
    }
  }
}

TEST_P(Photons, HaveTheSameBitsInAnyOrderOfQueriesAndForAnyNumberOfThreads)
{
  const Set set{"", photon_sets::clustered(30000, 4), 0.0005f};
  const MapPoints points = with_payload(set);
  std::vector<Point> places = photon_sets::queries(set, 5000, 9), backwards(places.rbegin(), places.rend());
  const PhotonMap map = make_map(device_, points, set.radius, 3);
  for (const gpurt_photon_query query : {GPURT_PHOTON_QUERY_COUNT, GPURT_PHOTON_QUERY_SUM,
                                         GPURT_PHOTON_QUERY_NEAREST, GPURT_PHOTON_QUERY_LIST}) {
    gpurt_photon_query_desc desc = query_desc(query, places, set.radius);
    desc.kernel = GPURT_GATHER_KERNEL_CONE;
    if (query == GPURT_PHOTON_QUERY_NEAREST) desc.k = 5, desc.radius = 0;
    const Answers answers = ask(map, desc);
    desc.coherence = GPURT_COHERENCE_COHERENT;
    EXPECT_TRUE(ask(map, desc) == answers) << "unsorted, query " << query;
    if (GetParam() == GPURT_DEVICE_CPU) {
      const Device three = make_device(GPURT_DEVICE_CPU, 3);
      EXPECT_TRUE(ask(make_map(three, points, set.radius, 3), desc) == answers) << "threads, query " << query;
      EXPECT_TRUE(ask(make_map(reference_, points, set.radius, 3), desc) == answers)
          << "thread, query " << query;
    }
    if (query == GPURT_PHOTON_QUERY_LIST) continue;
    desc.positions = backwards.data()->data();
    Answers reversed = ask(map, desc);
    std::reverse(reversed.counts.begin(), reversed.counts.end());
    std::reverse(reversed.sums.begin(), reversed.sums.end());
    EXPECT_EQ(reversed.counts, answers.counts);
    EXPECT_TRUE(reversed.sums == answers.sums);
  }
}

// The lists hold the same points; sums are in another order.
TEST_P(Photons, FromListsOfNodesAreThoseOfTheGrid)
{
  for (const Set &set : photon_sets::all(num_points)) {
    const MapPoints points = with_payload(set);
    std::vector<Point> places = photon_sets::queries(set, num_queries, 12);
    places.push_back({NAN, 0, 0});
    const PhotonMap map = make_map(device_, points, set.radius, 1);
    for (const float scale : {1.0f, 0.3f}) {
      for (const bool has_normals : {false, true}) {
        gpurt_photon_query_desc desc = query_desc(GPURT_PHOTON_QUERY_LIST, places, set.radius * scale);
        if (has_normals) desc.normals = places.data()->data();
        const Answers grid = ask(map, desc);
        desc.method = GPURT_GATHER_NODE_LISTS;
        const Answers lists = ask_both(points, set.radius, 1, desc);
        ASSERT_EQ(lists.offsets, grid.offsets) << set.name;
        for (size_t q = 0; q < places.size(); ++q) ASSERT_EQ(lists.listed(q), grid.listed(q)) << set.name;
        desc.query = GPURT_PHOTON_QUERY_SUM;
        desc.kernel = GPURT_GATHER_KERNEL_CONE;
        const Answers sums = ask_both(points, set.radius, 1, desc);
        desc.method = GPURT_GATHER_GRID;
        const Answers grid_sums = ask(map, desc);
        ASSERT_EQ(sums.counts, grid_sums.counts);
        for (size_t q = 0; q < places.size(); ++q) {
          // n additions of single precision in either order.
          const float n = float(sums.counts[q]);
          for (int k = 0; k < 3; ++k)
            ASSERT_NEAR(sums.sums[q][k], grid_sums.sums[q][k], n * n * 256 * 0x1p-23f);
        }
      }
    }
  }
}

TEST_P(Photons, AnswerManyThreadsAtOnce)
{
  const Set set{"", photon_sets::surface(20000, 4), 0.01f};
  const std::vector<Point> places = photon_sets::queries(set, 3000, 9);
  const PhotonMap map = make_map(device_, {set.points, {}, {}}, set.radius, 2);
  gpurt_photon_query_desc desc = query_desc(GPURT_PHOTON_QUERY_NEAREST, places, 0);
  desc.k = 9;
  const Answers expected = ask(map, desc);
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&] {
      for (int i = 0; i < 3; ++i) EXPECT_TRUE(ask(map, desc) == expected);
    });
  }
  for (std::thread &t : threads) t.join();
}

TEST_P(Photons, ChooseARadiusThatHoldsSome)
{
  const std::vector<std::pair<std::string, std::vector<Point>>> sets = {
      {"uniform", photon_sets::uniform(20000, 1)},
      {"surface", photon_sets::surface(20000, 1)},
      {"clustered", photon_sets::clustered(20000, 1)},
      {"one point", std::vector<Point>(100, Point{1, 2, 3})}};
  for (const auto &[name, points] : sets) {
    const PhotonMap map = make_map(device_, {points, {}, {}}, 0),
                    reference = make_map(reference_, {points, {}, {}}, 0);
    gpurt_photon_map_info info = GPURT_PHOTON_MAP_INFO_INIT, expected = GPURT_PHOTON_MAP_INFO_INIT;
    GPURT_ASSERT_OK(gpurt_photon_map_get_info(map, &info));
    GPURT_ASSERT_OK(gpurt_photon_map_get_info(reference, &expected));
    EXPECT_EQ(info.radius, expected.radius) << name;
    EXPECT_EQ(info.fullest_cell, expected.fullest_cell) << name;
    EXPECT_EQ(info.num_points, points.size());
    EXPECT_EQ(std::memcmp(info.bounds, expected.bounds, sizeof info.bounds), 0);
    EXPECT_GT(info.memory_bytes, points.size() * 16);
    const Answers counts = ask(map, query_desc(GPURT_PHOTON_QUERY_COUNT, points, info.radius));
    std::vector<uint32_t> sorted = counts.counts;
    std::sort(sorted.begin(), sorted.end());
    if (name == "one point") continue;
    // The densest places of a clustered set hold more than what is asked for in the mean, and others less.
    EXPECT_GT(sorted[sorted.size() * 3 / 4], 12u) << name;
    EXPECT_LT(sorted[sorted.size() / 2], 200u) << name;
  }
}

TEST_P(Photons, SurviveAFile)
{
  const Set set{"", photon_sets::surface(3000, 4), 0.03f};
  const MapPoints points = with_payload(set);
  const std::vector<Point> places = photon_sets::queries(set, 300, 9);
  const std::string path = testing::TempDir() + "/photons-" + std::to_string(GetParam()) + ".gpurt";
  gpurt_photon_query_desc desc = query_desc(GPURT_PHOTON_QUERY_SUM, places, set.radius);
  desc.normals = places.data()->data();
  const PhotonMap map = make_map(device_, points, set.radius, 3);
  const Answers expected = ask(map, desc);
  GPURT_ASSERT_OK(gpurt_photon_map_save(map, path.c_str()));
  // On either device.
  for (const gpurt_device device : {gpurt_device(device_), gpurt_device(reference_)}) {
    PhotonMap loaded;
    GPURT_ASSERT_OK(gpurt_photon_map_load(device, path.c_str(), loaded.out()));
    EXPECT_TRUE(ask(loaded, desc) == expected);
    gpurt_photon_map_info info = GPURT_PHOTON_MAP_INFO_INIT;
    GPURT_EXPECT_OK(gpurt_photon_map_get_info(loaded, &info));
    EXPECT_EQ(info.num_levels, 3u);
    EXPECT_EQ(info.has_normals, 1u);
    gpurt_photon_query_desc list = query_desc(GPURT_PHOTON_QUERY_LIST, places, set.radius);
    EXPECT_TRUE(ask(loaded, list) == ask(map, list));
  }
  std::string bytes;
  {
    std::ifstream in(path, std::ios::binary);
    bytes.assign(std::istreambuf_iterator<char>(in), {});
  }
  const auto refuses = [&](const std::string &damaged, const char *why) {
    std::ofstream(path, std::ios::binary | std::ios::trunc) << damaged;
    PhotonMap loaded;
    EXPECT_EQ(gpurt_photon_map_load(device_, path.c_str(), loaded.out()), GPURT_ERROR_IO) << why;
    EXPECT_NE(std::string(gpurt_last_error()).find(path), std::string::npos) << gpurt_last_error();
  };
  refuses(bytes.substr(0, bytes.size() - 1), "too short");
  refuses("", "empty");
  for (const size_t at :
       {size_t(0), size_t(8), size_t(13), size_t(17), size_t(26), size_t(30), bytes.size() / 2}) {
    std::string damaged = bytes;
    damaged[at] = char(damaged[at] ^ 0x10);
    refuses(damaged, "damaged");
  }
  std::remove(path.c_str());
  PhotonMap loaded;
  EXPECT_EQ(gpurt_photon_map_load(device_, path.c_str(), loaded.out()), GPURT_ERROR_IO);
  EXPECT_EQ(gpurt_photon_map_save(map, "/no/such/folder/map.gpurt"), GPURT_ERROR_IO);
}

TEST_P(Photons, RefuseWhatIsNotAllowed)
{
  Set set{"", photon_sets::uniform(5000, 4), 0.1f};
  MapPoints points = with_payload(set);
  const auto refuses = [&](const MapPoints &p, const std::string &text, auto &&change) {
    gpurt_photon_map_desc desc = GPURT_PHOTON_MAP_DESC_INIT;
    desc.num_points = p.positions.size();
    desc.positions = p.positions.data()->data();
    desc.fluxes = p.fluxes.data()->data();
    desc.normals = p.normals.data()->data();
    desc.radius = 0.1f;
    change(desc);
    PhotonMap map;
    EXPECT_EQ(gpurt_photon_map_create(device_, &desc, map.out()), GPURT_ERROR_INVALID_ARGUMENT) << text;
    EXPECT_NE(std::string(gpurt_last_error()).find(text), std::string::npos) << gpurt_last_error();
    EXPECT_EQ(gpurt_photon_map(map), nullptr);
  };
  const auto nothing = [](gpurt_photon_map_desc &) {};
  MapPoints bad = points;
  bad.positions[4321][1] = NAN, bad.positions[4000][2] = -inf;
  refuses(bad, "positions[4000]", nothing);
  bad = points, bad.fluxes[77][0] = -1, bad.fluxes[78][0] = NAN;
  refuses(bad, "fluxes[77]", nothing);
  bad = points, bad.normals[9][0] = inf;
  refuses(bad, "normals[9]", nothing);
  bad = points, bad.positions[0][0] = 3e38f, bad.positions[1][0] = -3e38f;
  refuses(bad, "positions reach", nothing);
  for (const float radius : {-1.0f, 1e-30f, inf, NAN})
    refuses(points, "radius", [=](gpurt_photon_map_desc &d) { d.radius = radius; });
  refuses(points, "positions", [](gpurt_photon_map_desc &d) { d.positions = nullptr; });
  refuses(points, "num_points", [](gpurt_photon_map_desc &d) { d.num_points = uint64_t(1) << 31; });
  refuses(points, "num_levels", [](gpurt_photon_map_desc &d) { d.num_levels = 9; });

  const PhotonMap map = make_map(device_, points, 0.1f),
                  plain = make_map(device_, {points.positions, {}, {}}, 0.1f);
  const std::vector<Point> places = photon_sets::queries(set, 100, 9);
  std::vector<uint32_t> counts(100), ids(5000);
  std::vector<float> sums(300), distances(5000);
  std::vector<uint64_t> offsets(101);
  const auto refuses_query = [&](gpurt_photon_map of, gpurt_photon_query kind, const std::string &text,
                                 auto &&change) {
    gpurt_photon_query_desc desc = query_desc(kind, places, 0.1f);
    if (kind == GPURT_PHOTON_QUERY_COUNT) desc.counts = counts.data();
    if (kind == GPURT_PHOTON_QUERY_SUM) desc.sums = sums.data();
    if (kind == GPURT_PHOTON_QUERY_LIST)
      desc.offsets = offsets.data(), desc.ids = ids.data(), desc.capacity = 5000;
    if (kind == GPURT_PHOTON_QUERY_NEAREST) desc.k = 3, desc.ids = ids.data();
    change(desc);
    EXPECT_EQ(gpurt_photon_map_query(of, &desc), GPURT_ERROR_INVALID_ARGUMENT) << text;
    EXPECT_NE(std::string(gpurt_last_error()).find(text), std::string::npos) << gpurt_last_error();
  };
  using D = gpurt_photon_query_desc;
  for (const float radius : {0.0f, -1.0f, inf, NAN})
    refuses_query(map, GPURT_PHOTON_QUERY_COUNT, "radius", [=](D &d) { d.radius = radius; });
  refuses_query(map, GPURT_PHOTON_QUERY_COUNT, "counts", [](D &d) { d.counts = nullptr; });
  refuses_query(map, GPURT_PHOTON_QUERY_COUNT, "positions", [](D &d) { d.positions = nullptr; });
  refuses_query(map, GPURT_PHOTON_QUERY_COUNT, "ids", [&](D &d) { d.ids = ids.data(); });
  refuses_query(plain, GPURT_PHOTON_QUERY_SUM, "fluxes", [](D &) {});
  refuses_query(plain, GPURT_PHOTON_QUERY_COUNT, "normals", [&](D &d) { d.normals = d.positions; });
  refuses_query(map, GPURT_PHOTON_QUERY_COUNT, "min_cosine",
                [&](D &d) { d.normals = d.positions, d.min_cosine = 2; });
  refuses_query(map, GPURT_PHOTON_QUERY_SUM, "overlap",
                [](D &d) { d.sums = const_cast<float *>(d.positions); });
  refuses_query(map, GPURT_PHOTON_QUERY_NEAREST, "k is 0", [](D &d) { d.k = 0; });
  refuses_query(map, GPURT_PHOTON_QUERY_NEAREST, "k is 513", [](D &d) { d.k = 513; });
  refuses_query(map, GPURT_PHOTON_QUERY_NEAREST, "radius_hint", [](D &d) { d.radius_hint = NAN; });
  refuses_query(map, GPURT_PHOTON_QUERY_NEAREST, "ids", [](D &d) { d.ids = nullptr; });
  refuses_query(map, GPURT_PHOTON_QUERY_NEAREST, "normals", [&](D &d) { d.normals = d.positions; });
  refuses_query(map, GPURT_PHOTON_QUERY_NEAREST, "NODE_LISTS",
                [](D &d) { d.method = GPURT_GATHER_NODE_LISTS; });
  refuses_query(map, GPURT_PHOTON_QUERY_LIST, "capacity", [](D &d) { d.capacity = 10; });
  // It tells what it needs.
  gpurt_photon_query_desc desc = query_desc(GPURT_PHOTON_QUERY_COUNT, places, 0.1f);
  const Answers expected = ask(map, desc);
  EXPECT_EQ(offsets[100], std::accumulate(expected.counts.begin(), expected.counts.end(), uint64_t(0)));
}

TEST_P(Photons, AreNoneInAnEmptyMap)
{
  gpurt_photon_map_desc map_desc = GPURT_PHOTON_MAP_DESC_INIT;
  PhotonMap map;
  GPURT_ASSERT_OK(gpurt_photon_map_create(device_, &map_desc, map.out()));
  const std::vector<Point> places = {{0, 0, 0}, {1, 2, 3}};
  EXPECT_EQ(ask(map, query_desc(GPURT_PHOTON_QUERY_COUNT, places, 1)).counts, (std::vector<uint32_t>{0, 0}));
  gpurt_photon_query_desc desc = query_desc(GPURT_PHOTON_QUERY_NEAREST, places, 0);
  desc.k = 2;
  EXPECT_EQ(ask(map, desc).ids, std::vector<uint32_t>(4, GPURT_INVALID_ID));
  desc = query_desc(GPURT_PHOTON_QUERY_LIST, places, 1);
  EXPECT_TRUE(ask(map, desc).ids.empty());
  desc.num_queries = 0;
  EXPECT_EQ(ask(map, desc).offsets, std::vector<uint64_t>{0});
}

TEST_P(Photons, KeepToTheMemoryLimit)
{
  const Device small = make_device(GetParam(), 0, 1 << 20);
  const MapPoints points{photon_sets::uniform(100000, 1), {}, {}};
  gpurt_photon_map_desc desc = GPURT_PHOTON_MAP_DESC_INIT;
  desc.num_points = points.positions.size();
  desc.positions = points.positions.data()->data();
  desc.radius = 0.1f;
  PhotonMap map;
  EXPECT_EQ(gpurt_photon_map_create(small, &desc, map.out()), GPURT_ERROR_OUT_OF_MEMORY);
  gpurt_device_properties properties = GPURT_DEVICE_PROPERTIES_INIT;
  GPURT_EXPECT_OK(gpurt_device_get_properties(small, &properties));
  EXPECT_EQ(properties.memory_used_bytes, 0u);
  desc.num_points = 1000;
  GPURT_EXPECT_OK(gpurt_photon_map_create(small, &desc, map.out()));
  GPURT_EXPECT_OK(gpurt_device_get_properties(small, &properties));
  gpurt_photon_map_info info = GPURT_PHOTON_MAP_INFO_INIT;
  GPURT_EXPECT_OK(gpurt_photon_map_get_info(map, &info));
  EXPECT_EQ(properties.memory_used_bytes, info.memory_bytes);
}

INSTANTIATE_TEST_SUITE_P(Cpu, Photons, testing::Values(GPURT_DEVICE_CPU));
INSTANTIATE_TEST_SUITE_P(Cuda, Photons, testing::Values(GPURT_DEVICE_CUDA));

}  // namespace
