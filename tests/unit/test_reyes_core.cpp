// REYES' shared mathematics: filters against their integrals, and bounds of pieces of patches against the points of these.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <random>
#include <tuple>
#include <vector>

#include "core/reyes/filter.h"
#include "core/reyes/split.h"

namespace gpurt {
namespace {

// Of one axis: sum of the weights, and of the places times them, over places that are even in [0, 1).
struct Moments {
  double mean = 0, first = 0, second = 0;
};

constexpr int num_places = 1 << 16;

Moments moments_of(ReyesFilter filter)
{
  FilterTable table;
  make_filter_table(filter, table);
  Moments m;
  for (int i = 0; i < num_places; ++i) {
    float weight = 1.0f;
    const float x =
        filter_place(table, filter == ReyesFilter::Mitchell, (float(i) + 0.5f) / num_places, weight);
    m.mean += double(weight) / num_places;
    m.first += double(weight) * double(x) / num_places;
    m.second += double(weight) * double(x) * double(x) / num_places;
  }
  return m;
}

// The integral over [-1.5, 1.5] of exp(-2 x^2) - exp(-4.5), and that of x^2 times it.
struct GaussianIntegrals {
  static constexpr double radius = 1.5;
  double plain, second;

  GaussianIntegrals()
  {
    const double rim = std::exp(-2 * radius * radius);
    const double bell = std::sqrt(M_PI / 2) * std::erf(radius * std::sqrt(2.0));
    plain = bell - 2 * radius * rim;
    second = bell / 4 - radius / 2 * rim - 2 * radius * radius * radius / 3 * rim;
  }
};

// What a random edge through a pixel covers of it.
struct RandomEdge {
  double a, b, c, coverage;  // covered: a x + b y < c

  explicit RandomEdge(std::mt19937_64 &rng)
  {
    std::uniform_real_distribution<double> number(0, 1);
    const double angle = 6.283185307179586 * number(rng);
    a = std::cos(angle);
    b = std::sin(angle);
    c = a * number(rng);
    c += b * number(rng);
    // The area of the square cut by the edge, by its corners in order.
    const double corner[5][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}, {0, 0}};
    std::vector<std::array<double, 2>> polygon;
    for (int k = 0; k < 4; ++k) {
      const double here = c - a * corner[k][0] - b * corner[k][1],
                   next = c - a * corner[k + 1][0] - b * corner[k + 1][1];
      if (here >= 0) polygon.push_back({corner[k][0], corner[k][1]});
      if ((here >= 0) == (next >= 0)) continue;
      const double t = here / (here - next);
      polygon.push_back({corner[k][0] + t * (corner[k + 1][0] - corner[k][0]),
                         corner[k][1] + t * (corner[k + 1][1] - corner[k][1])});
    }
    coverage = 0;
    for (size_t k = 0; k < polygon.size(); ++k) {
      const auto &p = polygon[k], &q = polygon[(k + 1) % polygon.size()];
      coverage += (p[0] * q[1] - q[0] * p[1]) / 2;
    }
  }

  // The squared error of n samples.
  template <class Place>
  double squared_error(int n, const Place &place) const
  {
    int num_covered = 0;
    for (int k = 0; k < n; ++k) {
      const Vec2f p = place(k);
      num_covered += a * double(p.x) + b * double(p.y) < c;
    }
    const double off = double(num_covered) / n - coverage;
    return off * off;
  }
};

// Samples of a pixel are stratified, though the film's halves are independent: coverage has far less variance than that of
// random places, and from 16 samples on as much as that of a place in each of n squares.
TEST(ReyesSamples, AreStratified)
{
  std::mt19937_64 rng(9);
  std::uniform_real_distribution<float> number(0, 1);
  for (const auto &[side, beside_random, beside_jittered] :
       {std::tuple{2, 0.62, 1.25}, {3, 0.45, 1.4}, {4, 0.28, 1.1}, {8, 0.15, 1.1}}) {
    const int n = side * side;
    double ours = 0, random = 0, jittered = 0;
    for (uint32_t trial = 0; trial < 40000; ++trial) {
      const RandomEdge edge(rng);
      ours += edge.squared_error(
          n, [&](int k) { return sample_2d(sample_key(7, 0, trial % 256, trial / 256, uint64_t(k)), 0); });
      random += edge.squared_error(n, [&](int) { return Vec2f{number(rng), number(rng)}; });
      jittered += edge.squared_error(n, [&, m = side](int k) {
        return Vec2f{(float(k % m) + number(rng)) / float(m), (float(k / m) + number(rng)) / float(m)};
      });
    }
    std::printf("%d samples: variance of coverage %.3f of random places', %.3f of jittered ones'\n", n,
                ours / random, ours / jittered);
    EXPECT_LT(ours, beside_random * random) << n;
    EXPECT_LT(ours, beside_jittered * jittered) << n;
  }
}

TEST(ReyesFilters, HaveTheMomentsOfTheirIntegrals)
{
  const Moments gaussian_moments = moments_of(ReyesFilter::Gaussian),
                mitchell_moments = moments_of(ReyesFilter::Mitchell);
  for (const Moments &m : {gaussian_moments, mitchell_moments}) {
    EXPECT_NEAR(m.mean, 1, 1e-4);
    EXPECT_NEAR(m.first, 0, 1e-5);
  }
  // Mitchell and Netravali: cubics with B + 2 C = 1 have the second moment B / 3.
  EXPECT_NEAR(mitchell_moments.second, 1.0 / 9, 1e-3);
  // The bell is a product, within 2 % of the exponential function.
  const GaussianIntegrals g;
  EXPECT_NEAR(gaussian_moments.second / (g.second / g.plain), 1, 0.02);
}

// Places lie in proportion to |f|: as many below x as its integral says.
TEST(ReyesFilters, PutPlacesInProportion)
{
  for (const ReyesFilter filter : {ReyesFilter::Gaussian, ReyesFilter::Mitchell}) {
    const bool is_mitchell = filter == ReyesFilter::Mitchell;
    FilterTable table;
    make_filter_table(filter, table);
    const auto density = [&](double x) {
      x = std::abs(x);
      if (!is_mitchell) return x < 1.5 ? std::exp(-2 * x * x) - std::exp(-4.5) : 0.0;
      constexpr double b = 1.0 / 3, c = 1.0 / 3;
      if (x < 1) return ((12 - 9 * b - 6 * c) * x * x * x + (-18 + 12 * b + 6 * c) * x * x + (6 - 2 * b)) / 6;
      if (x < 2)
        return ((-b - 6 * c) * x * x * x + (6 * b + 30 * c) * x * x + (-12 * b - 48 * c) * x +
                (8 * b + 24 * c)) /
               6;
      return 0.0;
    };
    const int steps = 4000;
    const double radius = is_mitchell ? 2 : 1.5, step = 2 * radius / steps;
    double all = 0;
    for (int i = 0; i < steps; ++i) all += std::abs(density((i + 0.5) * step - radius)) * step;
    std::vector<float> places, weights;
    for (int i = 0; i < num_places; ++i) {
      float weight = 1.0f;
      places.push_back(filter_place(table, is_mitchell, (float(i) + 0.5f) / num_places, weight));
      weights.push_back(weight);
    }
    EXPECT_TRUE(std::is_sorted(places.begin(), places.end()));
    double below = 0;
    for (int i = 0; i < steps; ++i) {
      below += std::abs(density((i + 0.5) * step - radius)) * step / all;
      const double x = (i + 1) * step - radius;
      const auto at = std::upper_bound(places.begin(), places.end(), float(x));
      EXPECT_NEAR(double(at - places.begin()) / num_places, below, is_mitchell ? 1e-3 : 4e-3) << x;
    }
    // The weight has the sign of f, which changes at 8/7, to a step of the table.
    for (size_t i = 0; i < places.size(); ++i) {
      if (std::abs(std::abs(places[i]) - 8.0f / 7) < 1.0f / 16) continue;
      EXPECT_EQ(weights[i] < 0, is_mitchell && std::abs(places[i]) > 1.1f) << places[i];
    }
  }
}

TEST(ReyesFilters, ReachAsFarAsTheySay)
{
  std::mt19937 random(3);
  std::uniform_real_distribution<float> unit(0.0f, 1.0f);
  for (const ReyesFilter filter : {ReyesFilter::Box, ReyesFilter::Gaussian, ReyesFilter::Mitchell}) {
    FilterTable table;
    make_filter_table(filter, table);
    const float reach = float(filter_reach(filter));
    float lowest = 1, highest = 0;
    for (int i = 0; i < 20000; ++i) {
      const float last = std::nextafter(1.0f, 0.0f);
      const Vec2f u{i == 0 ? 0.0f : std::min(unit(random), last),
                    i == 1 ? last : std::min(unit(random), last)};
      const FilteredPlace p = place_sample(filter, table, u);
      for (const float x : {p.offset.x, p.offset.y}) {
        lowest = std::min(lowest, x);
        highest = std::max(highest, x);
      }
      if (filter == ReyesFilter::Box) {
        EXPECT_EQ(p.offset.x, u.x);
        EXPECT_EQ(p.offset.y, u.y);
        EXPECT_EQ(p.weight, 1.0f);
      }
    }
    EXPECT_GE(lowest, -reach);
    EXPECT_LT(highest, 1 + reach);
    if (reach > 0) {
      EXPECT_LT(lowest, 1 - reach);
    }
  }
}

class Pieces : public testing::Test {
 protected:
  float uniform(float lo, float hi) { return std::uniform_real_distribution<float>(lo, hi)(random_); }

  // In pixels from the image's centre; through the eye plane where `depth` is less than its variation.
  RasterPatch random_patch(float depth)
  {
    RasterPatch patch;
    const float scale = uniform(20, 400), ox = uniform(-300, 300), oy = uniform(-300, 300);
    for (int k = 0; k < 16; ++k) {
      patch.w[k] = depth + uniform(-1, 1);
      patch.x[k] = scale * (float(k % 4) - 1.5f + uniform(-1, 1)) + ox * depth;
      patch.y[k] = scale * (float(k / 4) - 1.5f + uniform(-1, 1)) + oy * depth;
    }
    return patch;
  }

  // A piece that cuts at random leave, with edges that are decided or open.
  Piece random_piece(const RasterPatch &patch, const DiceSettings &dice)
  {
    Piece p = whole_patch();
    for (uint32_t depth = random_() % 12; depth > 0; --depth) {
      if (random_() % 2 == 0) {
        for (uint32_t e = 0; e < 4; ++e) {
          if (p.edge[e] == open_edge) p.edge[e] = decide_edge_of(patch, p, e, dice);
        }
      }
      const PieceAction actions[] = {PieceAction::SplitU, PieceAction::SplitV, PieceAction::SplitBoth};
      const PieceAction action = actions[random_() % 3];
      if (p.u_bits <= smallest_piece_bits + 1 || p.v_bits <= smallest_piece_bits + 1) break;
      Piece parts[4];
      const uint32_t n = split_piece(p, action, parts);
      p = parts[random_() % n];
    }
    return p;
  }

  static RasterPatch part_of(const RasterPatch &patch, const Piece &p)
  {
    RasterPatch part;
    const float u0 = parameter(p.u), u1 = parameter(p.u + (1u << p.u_bits));
    const float v0 = parameter(p.v), v1 = parameter(p.v + (1u << p.v_bits));
    sub_patch(patch.x, u0, u1, v0, v1, part.x);
    sub_patch(patch.y, u0, u1, v0, v1, part.y);
    sub_patch(patch.w, u0, u1, v0, v1, part.w);
    return part;
  }

  std::mt19937 random_{11};
};

// Wherever a point of a piece is on the image, also its moved corners, a rectangle there sees the piece: what is culled has no
// point in it.
TEST_F(Pieces, AreSeenWhereTheirPointsAre)
{
  const DiceSettings dice{2.0f, 256.0f, 256.0f};
  uint64_t num_seen = 0, num_moved = 0;
  for (int i = 0; i < 3000; ++i) {
    const RasterPatch patch = random_patch(i % 3 == 0 ? uniform(-0.5f, 0.9f) : uniform(1.5f, 20));
    const RasterPoint largest = largest_coordinates(patch.x, patch.y, patch.w, 16);
    const Piece piece = random_piece(patch, dice);
    const RasterPatch part = part_of(patch, piece);
    for (int k = 0; k < 40; ++k) {
      // A vertex that its grid may have: within the range, at its ends too, or a corner.
      uint32_t u = piece.u + (random_() & ((1u << piece.u_bits) - 1)),
               v = piece.v + (random_() & ((1u << piece.v_bits) - 1));
      if (k < 4) {
        u = piece.corner_u[k];
        v = piece.corner_v[k];
        num_moved += u != piece.u + (k & 1 ? 1u << piece.u_bits : 0) ||
                     v != piece.v + (k & 2 ? 1u << piece.v_bits : 0);
      } else if (k < 8) u = piece.u + (k & 1 ? 1u << piece.u_bits : 0);
      const RasterPoint q = patch_point(patch, u, v);
      if (!(q.w >= smallest_w)) continue;
      const float x = q.x / q.w, y = q.y / q.w;
      if (!(std::abs(x) < 1e6f && std::abs(y) < 1e6f)) continue;
      ++num_seen;
      // It lies in the rectangle, or on its rim.
      const float left = k % 2 == 0 ? x : x - uniform(0, 3), top = k % 3 == 0 ? y : y - uniform(0, 3);
      const RasterRect rect{left, top, std::max(x, left + uniform(0, 3)), std::max(y, top + uniform(0, 3))};
      const PieceHull hull = hull_of_piece(patch, part, piece);
      ASSERT_TRUE(can_be_seen(hull.x, hull.y, hull.w, hull.n, largest, rect))
          << "patch " << i << ", u " << parameter(u) << ", v " << parameter(v) << ", at " << x << ' ' << y;
    }
  }
  EXPECT_GT(num_seen, 50000u);
  EXPECT_GT(num_moved, 500u);
}

// And most rectangles that no point is in do not see it: the bound says something.
TEST_F(Pieces, AreNotSeenFarFromTheirPoints)
{
  const DiceSettings dice{2.0f, 256.0f, 256.0f};
  uint64_t num_seen = 0, num_beside = 0;
  for (int i = 0; i < 300; ++i) {
    const RasterPatch patch = random_patch(uniform(3, 20));
    const Piece piece = random_piece(patch, dice);
    const RasterPatch part = part_of(patch, piece);
    const ProjectedHull hull = projected_hull(part.x, part.y, part.w, 16);
    const RasterPoint largest = largest_coordinates(patch.x, patch.y, patch.w, 16);
    const float x = hull.x + 3 * hull.half_x + 1, y = hull.y - 3 * hull.half_y - 1;
    num_seen += can_be_seen(part.x, part.y, part.w, 16, largest, {x, y - 1, x + 1, y});
    ++num_beside;
  }
  EXPECT_EQ(num_seen, 0u) << "of " << num_beside;
}

// A point of a patch in pixels.
std::array<double, 2> pixel_of(const RasterPatch &patch, uint32_t u, uint32_t v)
{
  const RasterPoint p = patch_point(patch, u, v);
  return {double(p.x) / double(p.w), double(p.y) / double(p.w)};
}

double distance_of(const std::array<double, 2> &a, const std::array<double, 2> &b)
{
  return std::hypot(a[0] - b[0], a[1] - b[1]);
}

// Where flat regions are diced coarser, pieces stay as they are. Isolines that have fewer vertices leave the surface by less
// than half of what is allowed, cells by less than three quarters, and neither has edges of more than 2.83 pixels, or than the
// rate asks for: at rate 9 only turns at outlines get fewer vertices.
TEST_F(Pieces, AreTheSameWhereTheirGridsAreCoarser)
{
  for (const auto &[rate, flatness] : {std::pair{0.25f, 0.05f}, {0.25f, 0.3f}, {0.25f, 2.0f}, {9.0f, 4.0f}}) {
    const double longest = 1.41422 * std::max(2.0, std::sqrt(double(rate)));
    const DiceSettings fine = dice_settings(rate, 0.0f, 512, 512),
                       flat = dice_settings(rate, flatness, 512, 512);
    uint64_t num_edges = 0, num_coarser = 0, num_cells = 0, num_coarse_cells = 0;
    double worst_edge = 0, worst_cell = 0, longest_edge = 0, longest_cell = 0;
    for (int i = 0; i < 30; ++i) {
      const RasterPatch patch = random_patch(uniform(4, 20));
      std::vector<std::pair<Piece, Piece>> waiting = {{whole_patch(), whole_patch()}};
      while (!waiting.empty()) {
        auto [a, b] = waiting.back();
        waiting.pop_back();
        for (uint32_t e = 0; e < 4; ++e) {
          if (b.edge[e] != open_edge) continue;
          const uint32_t d = decide_edge_of(patch, b, e, flat), of_fine = decide_edge_of(patch, a, e, fine);
          ASSERT_EQ(d == open_edge, of_fine == open_edge);
          if (d == open_edge) continue;
          ASSERT_GE(d, of_fine);
          ++num_edges;
          if (d == of_fine) continue;
          ++num_coarser;
          const bool along_u = e < 2;
          const uint32_t from = along_u ? b.u : b.v, bits = along_u ? b.u_bits : b.v_bits;
          const uint32_t at = (along_u ? b.v : b.u) + ((e & 1) << (along_u ? b.v_bits : b.u_bits));
          const auto point = [&](uint32_t k) { return pixel_of(patch, along_u ? k : at, along_u ? at : k); };
          double sum = 0;
          for (uint32_t k = from; k < from + (1u << bits); k += 1u << d) {
            const auto p = point(k), q = point(k + (1u << d));
            sum += distance_of(p, q);
            for (uint32_t j = 1; j < 8; ++j) {
              // The nearest of the chord's points.
              const auto c = point(k + (j << d) / 8);
              const double px = q[0] - p[0], py = q[1] - p[1], square = px * px + py * py;
              const double t = std::clamp(((c[0] - p[0]) * px + (c[1] - p[1]) * py) / square, 0.0, 1.0);
              worst_edge = std::max(worst_edge, distance_of(c, {p[0] + t * px, p[1] + t * py}));
            }
          }
          longest_edge = std::max(longest_edge, sum / double(1u << (bits - d)));
        }
        const PieceAction action = decide_piece(patch, part_of(patch, a), fine, a);
        ASSERT_EQ(decide_piece(patch, part_of(patch, b), flat, b), action);
        if (action != PieceAction::Dice) {
          Piece of_a[4], of_b[4];
          const uint32_t n = split_piece(a, action, of_a);
          split_piece(b, action, of_b);
          for (uint32_t k = 0; k < n; ++k) waiting.emplace_back(of_a[k], of_b[k]);
          continue;
        }
        ASSERT_TRUE(b.grid_u <= a.grid_u && b.grid_v <= a.grid_v);
        num_cells += 1u << (a.grid_u + a.grid_v);
        num_coarse_cells += 1u << (b.grid_u + b.grid_v);
        if (b.grid_u == a.grid_u || b.grid_v == a.grid_v) continue;
        const uint32_t du = 1u << (b.u_bits - b.grid_u), dv = 1u << (b.v_bits - b.grid_v);
        for (uint32_t v = b.v; v < b.v + (1u << b.v_bits); v += dv) {
          double sum = 0;
          for (uint32_t u = b.u; u < b.u + (1u << b.u_bits); u += du) {
            const auto p = pixel_of(patch, u, v), q = pixel_of(patch, u + du, v),
                       r = pixel_of(patch, u, v + dv), s = pixel_of(patch, u + du, v + dv);
            sum += distance_of(p, q);
            worst_cell = std::max(worst_cell, distance_of(pixel_of(patch, u + du / 2, v + dv / 2),
                                                          {0.25 * (p[0] + q[0] + r[0] + s[0]),
                                                           0.25 * (p[1] + q[1] + r[1] + s[1])}));
          }
          longest_cell = std::max(longest_cell, sum / double(1u << b.grid_u));
        }
      }
    }
    std::printf(
        "rate %g, flatness %g: %llu of %llu edges coarser, off by %.4f, of %.2f pixels; %llu cells, not "
        "%llu, off by "
        "%.4f, of %.2f pixels\n",
        double(rate), double(flatness), (unsigned long long)num_coarser, (unsigned long long)num_edges,
        worst_edge, longest_edge, (unsigned long long)num_coarse_cells, (unsigned long long)num_cells,
        worst_cell, longest_cell);
    if (rate < 4.0f) {
      EXPECT_GT(num_coarser, num_edges / 10);
      EXPECT_LT(num_coarse_cells, num_cells / 2);
    } else {
      EXPECT_LT(num_coarser, num_edges / 10);
    }
    EXPECT_LE(worst_edge, 0.5 * double(flatness) + 1e-3);
    EXPECT_LE(worst_cell, 0.75 * double(flatness) + 1e-3);
    EXPECT_LE(longest_edge, longest + 1e-3);
    EXPECT_LE(longest_cell, longest + 1e-3);
  }
}

// The pixels of a root's box hold every point of it that is on the image.
TEST_F(Pieces, OfRootsLieInTheirBoxes)
{
  constexpr uint32_t width = 300, height = 200;
  uint64_t num_inside = 0, num_small = 0;
  for (int i = 0; i < 2000; ++i) {
    const RasterPatch patch = random_patch(i % 3 == 0 ? uniform(-0.5f, 0.9f) : uniform(1.5f, 20));
    RasterBox box;
    const bool is_there = raster_box(patch.x, patch.y, patch.w, 16, width, height, box);
    num_small += !is_there || box.x1 - box.x0 + 1 < int32_t(width) / 2;
    for (int k = 0; k < 40; ++k) {
      const RasterPoint q =
          patch_point(patch, random_() % (parameter_one + 1), random_() % (parameter_one + 1));
      if (!(q.w >= smallest_w)) continue;
      const float x = q.x / q.w + 0.5f * width, y = q.y / q.w + 0.5f * height;
      if (!(x >= 0 && y >= 0 && x < width && y < height)) continue;
      ++num_inside;
      ASSERT_TRUE(is_there) << "patch " << i << " at " << x << ' ' << y;
      ASSERT_TRUE(int32_t(x) >= box.x0 && int32_t(x) <= box.x1 && int32_t(y) >= box.y0 &&
                  int32_t(y) <= box.y1)
          << "patch " << i << " at " << x << ' ' << y;
    }
  }
  EXPECT_GT(num_inside, 3000u);
  EXPECT_GT(num_small, 200u);
}

}  // namespace
}  // namespace gpurt
