// What a ray meets, decided with exact arithmetic, and what a triangle test that rounds may make of it.
//
// The library's watertight test shears the corners of triangles onto the ray's main axis z,
//   x = (p_x - o_x) - (d_x/d_z)(p_z - o_z),   y likewise,
// and its verdict is that of exact geometry for the rounded corners. Let e be the test's unit roundoff (2^-24 in float,
// 2^-53 in double) and M = max |p_k - o_k| over the coordinates k of a corner. Rounding moves x by at most
//   e M  (p_x - o_x)  +  4 e M  (p_z - o_z, 1/d_z, times d_x, the product; |d_x/d_z| <= 1)  +  2 e M  (the difference)
//   = 7 e M,
// and terms of second order, under e M 2^-9: edge_bound is 7 + 2^-9. In double the edge functions are rounded too, so
// that a point within 2 e M of an edge may count for both sides, and 16 stands for all of it.
// So an edge moves by no more than delta = edge_bound e max(M_p, M_q) in x and in y, and
//   - if no edge of a triangle comes within delta of the ray (maximum norm, across the main axis), the test's verdict is
//     that of exact geometry: the triangle is 'clear';
//   - otherwise the test may say either: the triangle is 'near'. But near triangles that share near edges form a
//     cluster, whose outline no edge of which is near, winds about the ray as often after rounding as before. If that is
//     not 0 times, some triangle of the cluster is hit; if it is odd, an odd number of them. A watertight test has no
//     other freedom.
#pragma once

#include <cstdint>
#include <vector>

#include "rays.h"

namespace gpurt_test {

/// The bound on how far rounding moves a sheared corner, in units of roundoff times M.
struct TestPrecision {
  const char *name;
  double unit_roundoff;
  double edge_bound;
};
inline constexpr TestPrecision float_precision = {"float", 0x1p-24, 7.0 + 0x1p-9};
inline constexpr TestPrecision double_precision = {"double", 0x1p-53, 16.0};

/// A triangle that the test may say is hit.
struct Candidate {
  uint32_t triangle;
  bool is_near;
  bool is_met;          // exact: the line of the ray meets the closed triangle, and not within its plane
  float t_low, t_high;  // where the library's t may lie
  uint32_t cluster;     // of near candidates
};

/// Near triangles joined by near edges.
struct Cluster {
  bool is_open = false;  // an edge near the ray belongs to one triangle alone: a hole is no leak
  int winding = 0;       // how often the outline winds about the ray
  float t_low = infinite, t_high = -infinite;
};

struct RayTruth {
  std::vector<Candidate> candidates;  // along the whole line of the ray
  std::vector<Cluster> clusters;
  uint32_t nearest = GPURT_INVALID_ID;  // triangle: exact, of the clear ones that are met in [tmin, tmax]

  const Candidate *find(uint32_t triangle) const;
};

class ExactOracle {
 public:
  explicit ExactOracle(const Mesh &mesh);

  RayTruth operator()(const gpurt_ray &ray, const TestPrecision &precision) const;

  /// Zero area, exactly: legal, never hit, and in no leaf of a tree made here.
  bool is_degenerate(uint32_t triangle) const { return is_degenerate_[triangle]; }
  const Mesh &mesh() const { return mesh_; }
  uint64_t num_degenerate() const;

  /// Decisions taken so far, and those that intervals of doubles left to rational arithmetic.
  mutable uint64_t num_decisions = 0, num_exact_decisions = 0;

 private:
  struct Node {
    double lo[3], hi[3];
    uint32_t first, count;  // leaf: of order_; inner: count 0, children first and first + 1
  };
  void build(uint32_t node, uint32_t first, uint32_t count);
  void cluster_up(const gpurt_ray &ray, int kz, RayTruth &truth,
                  const std::vector<uint32_t> &near_edges) const;

  const Mesh &mesh_;
  std::vector<std::array<uint32_t, 3>> position_;  // triangles by distinct position
  std::vector<bool> is_degenerate_;
  std::vector<uint32_t> order_;
  std::vector<Node> nodes_;
};

}  // namespace gpurt_test
