// The leaves that the descent visits, against those that the ray passes exactly.
//
// A tree made by CGAL, planes rounded to float, is walked twice: by traverse_kd, which records the leaves, and with
// interval arithmetic that falls back on rationals. Both walk near sides first, so the exact sequence must be a
// subsequence of the recorded one. Of every other leaf that was visited, the cell grown by the stated widening must meet
// the ray: kd_traverse.h leaves a child out only if planes at s_i and s_j, each known to 3 eps M/|d|, are apart by more
// than their widenings of 16 eps M/|d| and a rounding of 2 eps M/|d| (eps = 2^-24, M the reach of the tree's bounds). So
// two planes that bound a visited cell may be passed in the wrong order by no more than 21 eps M/|d| each: the ray meets
// the cell whose planes have moved outwards by 21 eps M.
#include <CGAL/Exact_rational.h>
#include <CGAL/Interval_nt.h>

#include "../support/cgal_tree.h"
#include "core/accel/kd_traverse.h"

namespace {

using namespace gpurt_test;
using Interval = CGAL::Interval_nt<false>;
using Rational = CGAL::Exact_rational;

struct Cell {
  Point lo, hi;
};

// The leaves of the closed cells that the ray meets, near sides first.
template <class NT>
class ExactWalk {
 public:
  ExactWalk(const ExchangeTree &tree, const gpurt_ray &ray) : tree_(tree), ray_(ray)
  {
    NT a(double(ray.tmin)), b(double(ray.tmax));
    for (int k = 0; k < 3; ++k) {
      const NT o(double(ray.origin[k])), d(double(ray.direction[k]));
      const NT lo = NT(double(tree.bounds.lo[k])) - o, hi = NT(double(tree.bounds.hi[k])) - o;
      if (ray.direction[k] == 0) {
        if (lo > NT(0) || hi < NT(0)) return;
        continue;
      }
      const NT enter = (ray.direction[k] > 0 ? lo : hi) / d, leave = (ray.direction[k] > 0 ? hi : lo) / d;
      if (enter > a) a = enter;
      if (leave < b) b = leave;
    }
    if (!(a > b)) walk(0, a, b);
  }

  std::vector<uint32_t> leaves;

 private:
  void walk(uint32_t index, const NT &a, const NT &b)
  {
    const gpurt_kdtree_node n = tree_.nodes[index];
    const int k = int(n.tag & 3u);
    if (k == 3) {
      if (n.tag >> 2 != 0) leaves.push_back(index);
      return;
    }
    float plane;
    std::memcpy(&plane, &n.word, sizeof plane);
    const uint32_t below = n.tag >> 2, above = below + 1;
    if (ray_.direction[k] == 0) {
      if (ray_.origin[k] <= plane) walk(below, a, b);
      if (ray_.origin[k] >= plane) walk(above, a, b);
      return;
    }
    const NT s = (NT(double(plane)) - NT(double(ray_.origin[k]))) / NT(double(ray_.direction[k]));
    const bool down = ray_.direction[k] < 0;
    if (!(s < a)) walk(down ? above : below, a, s < b ? s : b);
    if (!(s > b)) walk(down ? below : above, s > a ? s : a, b);
  }

  const ExchangeTree &tree_;
  const gpurt_ray &ray_;
};

std::vector<uint32_t> exact_leaves(const ExchangeTree &tree, const gpurt_ray &ray, uint64_t &num_rational)
{
  try {
    const Interval::Protector rounding;
    return ExactWalk<Interval>(tree, ray).leaves;
  } catch (const CGAL::Uncertain_conversion_exception &) {
    ++num_rational;
    return ExactWalk<Rational>(tree, ray).leaves;
  }
}

// By how much a cell's planes have to move outwards for the ray to meet it.
double distance_to_cell(const gpurt_ray &ray, const Cell &cell)
{
  double distance = 0;
  struct Bound {
    double s, speed;  // moving the plane by x moves s by x * speed
  };
  // tmin and tmax are widened as planes across the main axis are.
  const double steepest =
      1 / std::max({std::abs(ray.direction[0]), std::abs(ray.direction[1]), std::abs(ray.direction[2])});
  std::vector<Bound> lower = {{ray.tmin, steepest}}, upper = {{ray.tmax, steepest}};
  for (int k = 0; k < 3; ++k) {
    const double lo = double(cell.lo[k]) - ray.origin[k], hi = double(cell.hi[k]) - ray.origin[k],
                 d = ray.direction[k];
    if (d == 0) {
      distance = std::max({distance, lo, -hi});
      continue;
    }
    lower.push_back({(d > 0 ? lo : hi) / d, 1 / std::abs(d)});
    upper.push_back({(d > 0 ? hi : lo) / d, 1 / std::abs(d)});
  }
  for (const Bound &x : lower) {
    for (const Bound &y : upper) {
      if (x.s > y.s && x.speed + y.speed > 0)
        distance = std::max(distance, (x.s - y.s) / (x.speed + y.speed));
    }
  }
  return distance;
}

void collect_cells(const ExchangeTree &tree, uint32_t index, const Cell &cell, std::vector<Cell> &cells)
{
  cells[index] = cell;
  const gpurt_kdtree_node n = tree.nodes[index];
  const int k = int(n.tag & 3u);
  if (k == 3) return;
  float plane;
  std::memcpy(&plane, &n.word, sizeof plane);
  Cell below = cell, above = cell;
  below.hi[k] = above.lo[k] = plane;
  collect_cells(tree, n.tag >> 2, below, cells);
  collect_cells(tree, (n.tag >> 2) + 1, above, cells);
}

class KdLeaves : public ::testing::TestWithParam<std::string> {};

TEST_P(KdLeaves, AreThoseThatTheRayPasses)
{
  const NamedMesh m = mesh_of_kind(GetParam());
  double largest = 0;
  uint64_t num_rays = 0, num_exact = 0, num_extra = 0, num_rational = 0, num_lost = 0, num_far = 0;
  for (const TreeCut cut : {TreeCut::Median, TreeCut::SlidingMidpoint}) {
    const ExchangeTree tree = build_cgal_tree(m.mesh, TreePoints::Vertices, cut, 6);
    ASSERT_LE(tree.depth, uint32_t(gpurt::kd_max_depth));
    std::vector<Cell> cells(tree.nodes.size());
    collect_cells(tree, 0, {tree.bounds.lo, tree.bounds.hi}, cells);
    std::map<uint32_t, uint32_t> leaf_at;  // by the first reference; leaves without references are not shown
    for (uint32_t i = 0; i < tree.nodes.size(); ++i) {
      if ((tree.nodes[i].tag & 3u) == 3u && tree.nodes[i].tag >> 2 != 0) leaf_at[tree.nodes[i].word] = i;
    }
    std::vector<gpurt::KdNode> nodes;
    for (const auto &n : tree.nodes) nodes.push_back({n.word, n.tag});
    const auto vec = [](const float *p) { return gpurt::Vec3f{p[0], p[1], p[2]}; };
    const gpurt::KdTreeView view = {nodes.data(),
                                    tree.references.data(),
                                    {vec(tree.bounds.lo.data()), vec(tree.bounds.hi.data())},
                                    uint32_t(nodes.size())};

    RaySource source(m.mesh, split_planes(tree.nodes), 11);
#if defined(__SANITIZE_ADDRESS__)
    const int rays_of_kind = 250;
#else
    const int rays_of_kind = 2500;
#endif
    for (int kind = 0; kind < int(RayKind::Count); ++kind) {
      for (int i = 0; i < rays_of_kind; ++i) {
        gpurt_ray ray = source(RayKind(kind));
        if (i % 4 == 0)
          ray.tmin = float(uniform(source.rng())), ray.tmax = ray.tmin + float(uniform(source.rng()));
        gpurt::TraceRay ready;
        ASSERT_TRUE(gpurt::prepare_ray(vec(ray.origin), vec(ray.direction), ray.tmin, ray.tmax, ready));
        std::vector<uint32_t> visited;
        float limit = ready.tmax;
        gpurt::traverse_kd(view, ready, limit, [&](uint32_t first, uint32_t) {
          visited.push_back(leaf_at.at(first));
          return false;
        });
        gpurt_ray finite = ray;  // exact numbers have no infinity; beyond this the tree has ended
        finite.tmax = std::min(finite.tmax, std::numeric_limits<float>::max());
        const std::vector<uint32_t> exact = exact_leaves(tree, finite, num_rational);
        ++num_rays;
        num_exact += exact.size();
        double reach = 0;
        for (int k = 0; k < 3; ++k) {
          reach = std::max({reach, std::abs(double(tree.bounds.lo[k]) - ray.origin[k]),
                            std::abs(double(tree.bounds.hi[k]) - ray.origin[k])});
        }
        size_t next = 0;
        for (uint32_t leaf : visited) {
          if (next < exact.size() && exact[next] == leaf) {
            ++next;
            continue;
          }
          ++num_extra;
          const double distance = distance_to_cell(ray, cells[leaf]) / (0x1p-24 * reach);
          largest = std::max(largest, distance);
          num_far += distance > 21;
        }
        if (next == exact.size()) continue;
        if (++num_lost <= 3) {
          ADD_FAILURE() << "the exact sequence is not a subsequence: " << ray_kind_names[kind] << " ray "
                        << std::hexfloat << ray.origin[0] << " " << ray.origin[1] << " " << ray.origin[2]
                        << ", " << ray.direction[0] << " " << ray.direction[1] << " " << ray.direction[2]
                        << ", t in [" << ray.tmin << ", " << ray.tmax << "]";
        }
      }
    }
  }
  EXPECT_EQ(num_lost, 0u);
  EXPECT_EQ(num_far, 0u) << "leaves further from their rays than the widening explains";
  std::printf(
      "%s: %llu rays, %.2f leaves a ray exactly, %.4f more visited, furthest %.2f eps M; %.3f%% by "
      "rationals\n",
      m.name.c_str(), static_cast<unsigned long long>(num_rays), double(num_exact) / double(num_rays),
      double(num_extra) / double(num_rays), largest, 100.0 * double(num_rational) / double(num_rays));
}

INSTANTIATE_TEST_SUITE_P(Meshes, KdLeaves, ::testing::ValuesIn(mesh_kinds),
                         [](const auto &info) { return info.param; });

}  // namespace
