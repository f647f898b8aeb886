// Source: for filtered decisions, Brönnimann, Burnikel and Pion 2001 (interval arithmetic, as in CGAL).
#include "exact_oracle.h"

#include <CGAL/Exact_rational.h>
#include <CGAL/Interval_nt.h>

#include <numeric>

namespace gpurt_test {
namespace {

using Interval = CGAL::Interval_nt<false>;
using Rational = CGAL::Exact_rational;

// The main axis, by the library's rule: which axis wins a tie decides which rounding there is.
int main_axis(const gpurt_ray &ray)
{
  const float x = std::abs(ray.direction[0]), y = std::abs(ray.direction[1]), z = std::abs(ray.direction[2]);
  return x < y ? (y < z ? 2 : 1) : (x < z ? 2 : 0);
}

// A ray and a triangle in number type NT, sheared and scaled by d_z so that nothing is divided.
template <class NT>
struct Sheared {
  NT x[3], y[3];

  Sheared(const gpurt_ray &ray, int kz, const Point (&p)[3])
  {
    const int kx = (kz + 1) % 3, ky = (kz + 2) % 3;
    const NT dx(double(ray.direction[kx])), dy(double(ray.direction[ky])), dz(double(ray.direction[kz]));
    for (int i = 0; i < 3; ++i) {
      const NT z = NT(double(p[i][kz])) - NT(double(ray.origin[kz]));
      x[i] = dz * (NT(double(p[i][kx])) - NT(double(ray.origin[kx]))) - dx * z;
      y[i] = dz * (NT(double(p[i][ky])) - NT(double(ray.origin[ky]))) - dy * z;
    }
  }
};

// True if double precision already shows that the sheared triangle is further than `far` from the ray: an axis of the
// triangle or of the square about the ray separates them. `size` bounds the coordinates, and so the rounding.
bool is_far(const Sheared<double> &s, double far, double size)
{
  if ((s.x[0] > far && s.x[1] > far && s.x[2] > far) || (s.x[0] < -far && s.x[1] < -far && s.x[2] < -far) ||
      (s.y[0] > far && s.y[1] > far && s.y[2] > far) || (s.y[0] < -far && s.y[1] < -far && s.y[2] < -far)) {
    return true;
  }
  double cross[3];
  for (int i = 0; i < 3; ++i) cross[i] = s.x[i] * s.y[(i + 1) % 3] - s.y[i] * s.x[(i + 1) % 3];
  const double area = cross[0] + cross[1] + cross[2];
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3;
    const double threshold =
        far * (std::abs(s.x[j] - s.x[i]) + std::abs(s.y[j] - s.y[i])) + 0x1p-46 * size * size;
    // Across the edge, its corners lie at -cross and the third corner at area - cross.
    if (std::min(-cross[i], area - cross[i]) > threshold || std::max(-cross[i], area - cross[i]) < -threshold)
      return true;
  }
  return false;
}

struct Verdict {
  uint32_t near_edges;  // bit i: the edge from corner i to corner i + 1
  bool is_met;
  bool is_edge_on;
};

// delta[i]: how far the edge from corner i may move, scaled as the corners are.
template <class NT>
Verdict examine(const gpurt_ray &ray, int kz, const Point (&p)[3], const double (&delta)[3])
{
  const Sheared<NT> s(ray, kz, p);
  Verdict verdict = {0, false, false};
  int num_positive = 0, num_negative = 0;
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3;
    const NT cross = s.x[i] * s.y[j] - s.y[i] * s.x[j];
    if (cross > NT(0)) ++num_positive;
    else if (cross < NT(0)) ++num_negative;
    // The edge is near if it meets the square of half side delta about the ray: three axes may separate them.
    const NT d(delta[i]);
    if ((s.x[i] > d && s.x[j] > d) || (s.x[i] < -d && s.x[j] < -d)) continue;
    if ((s.y[i] > d && s.y[j] > d) || (s.y[i] < -d && s.y[j] < -d)) continue;
    if (CGAL::abs(cross) > d * (CGAL::abs(s.x[j] - s.x[i]) + CGAL::abs(s.y[j] - s.y[i]))) continue;
    verdict.near_edges |= 1u << i;
  }
  verdict.is_edge_on = num_positive == 0 && num_negative == 0;
  verdict.is_met = !verdict.is_edge_on && (num_positive == 0 || num_negative == 0);
  return verdict;
}

template <class NT>
std::array<NT, 3> difference(const float *a, const float *b)
{
  return {NT(double(a[0])) - NT(double(b[0])), NT(double(a[1])) - NT(double(b[1])),
          NT(double(a[2])) - NT(double(b[2]))};
}
template <class NT>
std::array<NT, 3> cross(const std::array<NT, 3> &a, const std::array<NT, 3> &b)
{
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
template <class NT>
NT dot(const std::array<NT, 3> &a, const std::array<NT, 3> &b)
{
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// t = num / det of the plane of a triangle, det > 0 where it is not 0.
template <class NT>
struct PlaneDistance {
  NT num, det;

  PlaneDistance(const gpurt_ray &ray, const Point (&p)[3])
  {
    const auto e1 = difference<NT>(p[1].data(), p[0].data()), e2 = difference<NT>(p[2].data(), p[0].data());
    const auto s = difference<NT>(ray.origin, p[0].data());
    const std::array<NT, 3> d = {NT(double(ray.direction[0])), NT(double(ray.direction[1])),
                                 NT(double(ray.direction[2]))};
    num = dot(e2, cross(s, e1));
    det = dot(e1, cross(d, e2));
    if (det < NT(0)) num = -num, det = -det;
  }
};

template <class NT>
int compare_distances(const gpurt_ray &ray, const Point (&p)[3], const Point (&q)[3])
{
  const PlaneDistance<NT> x(ray, p), y(ray, q);
  const NT a = x.num * y.det, b = y.num * x.det;
  if (a < b) return -1;
  return a > b ? 1 : 0;
}

// f with intervals; where they cannot decide, with rationals.
template <class F, class G>
auto decide(const ExactOracle &oracle, F &&with_intervals, G &&with_rationals)
{
  ++oracle.num_decisions;
  try {
    const Interval::Protector rounding;
    return with_intervals();
  } catch (const CGAL::Uncertain_conversion_exception &) {
    ++oracle.num_exact_decisions;
    return with_rationals();
  }
}

struct Range {
  double low = infinite, high = -infinite;
};

// Where along the main axis, from the ray's origin, the part of a triangle lies that is within `width` of the ray across it.
Range range_near_ray(const gpurt_ray &ray, int kz, const Point (&p)[3], double width)
{
  typedef std::array<long double, 3> Corner;
  const Sheared<long double> s(ray, kz, p);
  const long double dz = ray.direction[kz];
  std::vector<Corner> part;
  for (int i = 0; i < 3; ++i)
    part.push_back({s.x[i] / dz, s.y[i] / dz, static_cast<long double>(p[i][kz]) - ray.origin[kz]});
  for (int side = 0; side < 4; ++side) {
    const auto inside = [&](const Corner &c) { return width - (side % 2 ? 1 : -1) * c[side / 2]; };
    std::vector<Corner> kept;
    for (size_t i = 0; i < part.size(); ++i) {
      const Corner &a = part[i], &b = part[(i + 1) % part.size()];
      const long double da = inside(a), db = inside(b);
      if (da >= 0) kept.push_back(a);
      if ((da < 0) == (db < 0)) continue;
      const long double share = da / (da - db);
      Corner c;
      for (int k = 0; k < 3; ++k) c[k] = a[k] + share * (b[k] - a[k]);
      kept.push_back(c);
    }
    part = kept;
  }
  Range range;
  for (const Corner &c : part) {
    range.low = std::min(range.low, double(c[2]));
    range.high = std::max(range.high, double(c[2]));
  }
  return range;
}

// Where the library's t of an accepted triangle may lie.
//
// Of a clear triangle it is num/det of PlaneDistance in double, u = 2^-53. Num is a sum of products of three differences with
// at most 8 rounded operations on any path, det of two differences and a direction with 7, so that with A the same sums of
// magnitudes, |num' - num| <= 8.01 u A_num and |det' - det| <= 7.01 u A_det (Higham 2002, Section 3.1). 1/det and the
// product round twice more. The result is cut to the triangle's extent along the main axis, and rounded to float once,
// which is monotonic: so both ends can be rounded to float as well.
//
// Of a near triangle, whose plane the ray may meet far from it, and of one of which roundings may be all that is seen, it is
// where the ray passes the triangle: within the test's rounding, or within 4 eps M in space, which is 8 eps M across the ray
// and 4 eps M along it (eps = 2^-24, and M the largest distance of a corner from the origin along an axis).
void bound_distance(const gpurt_ray &ray, int kz, const Point (&p)[3], double edge_unit, Candidate &candidate)
{
  const double u = 0x1p-53;
  const auto e1 = difference<double>(p[1].data(), p[0].data()),
             e2 = difference<double>(p[2].data(), p[0].data());
  const auto s = difference<double>(ray.origin, p[0].data());
  const std::array<double, 3> d = {ray.direction[0], ray.direction[1], ray.direction[2]};
  const auto sum_of_magnitudes = [](const std::array<double, 3> &a, const std::array<double, 3> &b,
                                    const std::array<double, 3> &c) {
    const double x = std::abs(a[0]), y = std::abs(a[1]), z = std::abs(a[2]);
    const double bx = std::abs(b[0]), by = std::abs(b[1]), bz = std::abs(b[2]);
    const double cx = std::abs(c[0]), cy = std::abs(c[1]), cz = std::abs(c[2]);
    return x * (by * cz + bz * cy) + y * (bz * cx + bx * cz) + z * (bx * cy + by * cx);
  };
  // Twice: this computation rounds as the library's does.
  const double num = dot(e2, cross(s, e1)), num_error = 2 * 8.01 * u * sum_of_magnitudes(e2, s, e1);
  const double det = dot(e1, cross(d, e2)), det_error = 2 * 7.01 * u * sum_of_magnitudes(e1, d, e2);
  double ends[2] = {infinite, -infinite};
  for (int i = 0; i < 3; ++i) {
    const double t = (double(p[i][kz]) - ray.origin[kz]) / ray.direction[kz];
    ends[0] = std::min(ends[0], t - 4 * u * std::abs(t));
    ends[1] = std::max(ends[1], t + 4 * u * std::abs(t));
  }
  const auto largest = [](const std::array<double, 3> &x) {
    return std::max({std::abs(x[0]), std::abs(x[1]), std::abs(x[2])});
  };
  const double smallest_det = 0x1p-17 * largest(e1) * largest(e2) * largest(d);
  double low = infinite, high = -infinite;
  if (!candidate.is_near && std::abs(det) > det_error) {
    const double t = num / det;
    const double bound =
        (num_error + std::abs(t) * det_error) / (std::abs(det) - det_error) + 4 * u * std::abs(t);
    low = t - bound;
    high = t + bound;
  }
  if (candidate.is_near || !(std::abs(det) > smallest_det)) {
    double reach = 0;
    for (const Point &corner : p) {
      for (int k = 0; k < 3; ++k) reach = std::max(reach, std::abs(double(corner[k]) - ray.origin[k]));
    }
    const double eps = 0x1p-24, dz = std::abs(double(ray.direction[kz]));
    const Range range = range_near_ray(ray, kz, p, std::max(edge_unit, 8 * eps) * 1.01 * reach);
    const double sign = ray.direction[kz] > 0 ? 1 : -1;
    for (const double z : {range.low, range.high}) {
      low = std::min(low, (sign * z - 4.01 * eps * reach) / dz);
      high = std::max(high, (sign * z + 4.01 * eps * reach) / dz);
    }
  }
  low = std::clamp(low, ends[0], ends[1]);
  high = std::clamp(high, ends[0], ends[1]);
  candidate.t_low = float(low);
  candidate.t_high = float(high);
}

}  // namespace

const Candidate *RayTruth::find(uint32_t triangle) const
{
  for (const Candidate &c : candidates) {
    if (c.triangle == triangle) return &c;
  }
  return nullptr;
}

ExactOracle::ExactOracle(const Mesh &mesh) : mesh_(mesh), is_degenerate_(mesh.triangles.size())
{
  std::map<Point, uint32_t> index;
  for (uint32_t i = 0; i < mesh.triangles.size(); ++i) {
    const Point p[3] = {mesh.corner(i, 0), mesh.corner(i, 1), mesh.corner(i, 2)};
    std::array<uint32_t, 3> ids;
    for (int k = 0; k < 3; ++k) {
      const Point q = {p[k][0] + 0.0f, p[k][1] + 0.0f, p[k][2] + 0.0f};
      ids[k] = index.try_emplace(q, uint32_t(index.size())).first->second;
    }
    position_.push_back(ids);
    const auto e1 = difference<Rational>(p[1].data(), p[0].data());
    const auto e2 = difference<Rational>(p[2].data(), p[0].data());
    const auto n = cross(e1, e2);
    is_degenerate_[i] = n[0] == 0 && n[1] == 0 && n[2] == 0;
    if (!is_degenerate_[i]) order_.push_back(i);
  }
  nodes_.resize(1);
  build(0, 0, uint32_t(order_.size()));
}

uint64_t ExactOracle::num_degenerate() const
{
  return uint64_t(std::count(is_degenerate_.begin(), is_degenerate_.end(), true));
}

// A hierarchy of boxes, halved at the median along the longest side; it only sieves.
void ExactOracle::build(uint32_t node, uint32_t first, uint32_t count)
{
  Node n = {{infinite, infinite, infinite}, {-infinite, -infinite, -infinite}, first, count};
  for (uint32_t i = first; i < first + count; ++i) {
    for (int corner = 0; corner < 3; ++corner) {
      const Point p = mesh_.corner(order_[i], corner);
      for (int k = 0; k < 3; ++k)
        n.lo[k] = std::min(n.lo[k], double(p[k])), n.hi[k] = std::max(n.hi[k], double(p[k]));
    }
  }
  if (count > 4) {
    int axis = 0;
    for (int k = 1; k < 3; ++k) {
      if (n.hi[k] - n.lo[k] > n.hi[axis] - n.lo[axis]) axis = k;
    }
    const auto middle = order_.begin() + first + count / 2;
    const auto centre = [&](uint32_t t) {
      return double(mesh_.corner(t, 0)[axis]) + mesh_.corner(t, 1)[axis] + mesh_.corner(t, 2)[axis];
    };
    std::nth_element(order_.begin() + first, middle, order_.begin() + first + count,
                     [&](uint32_t a, uint32_t b) { return centre(a) < centre(b); });
    const uint32_t child = uint32_t(nodes_.size());
    nodes_.resize(child + 2);
    build(child, first, count / 2);
    build(child + 1, first + count / 2, count - count / 2);
    n.first = child;
    n.count = 0;
  }
  nodes_[node] = n;
}

RayTruth ExactOracle::operator()(const gpurt_ray &ray, const TestPrecision &precision) const
{
  RayTruth truth;
  if (order_.empty()) return truth;
  const int kz = main_axis(ray);
  const double dz = std::abs(double(ray.direction[kz]));
  const double unit = precision.edge_bound * precision.unit_roundoff;
  // Boxes grow by more than the largest delta, which also pays for the rounding of what sieves them.
  double reach = 0;
  for (int k = 0; k < 3; ++k) {
    reach = std::max(
        {reach, std::abs(nodes_[0].lo[k] - ray.origin[k]), std::abs(nodes_[0].hi[k] - ray.origin[k])});
  }
  const double margin = std::max(8 * float_precision.unit_roundoff, 1.1 * unit) * reach;

  std::vector<uint32_t> near_edges;  // of the near candidates, in order: bit i as in Verdict
  uint32_t todo[64], num_todo = 0;
  todo[num_todo++] = 0;
  while (num_todo != 0) {
    const Node &n = nodes_[todo[--num_todo]];
    double enter = -infinite, leave = infinite;
    for (int k = 0; k < 3; ++k) {
      const double lo = n.lo[k] - margin - ray.origin[k], hi = n.hi[k] + margin - ray.origin[k],
                   d = ray.direction[k];
      if (d == 0) {
        if (lo > 0 || hi < 0) leave = -infinite;
        continue;
      }
      enter = std::max(enter, std::min(lo / d, hi / d));
      leave = std::min(leave, std::max(lo / d, hi / d));
    }
    if (enter > leave) continue;
    if (n.count == 0) {
      todo[num_todo++] = n.first + 1;
      todo[num_todo++] = n.first;
      continue;
    }
    for (uint32_t i = n.first; i < n.first + n.count; ++i) {
      const uint32_t id = order_[i];
      const Point p[3] = {mesh_.corner(id, 0), mesh_.corner(id, 1), mesh_.corner(id, 2)};
      double size[3];
      for (int c = 0; c < 3; ++c) {
        size[c] = 0;
        for (int k = 0; k < 3; ++k) size[c] = std::max(size[c], std::abs(double(p[c][k]) - ray.origin[k]));
      }
      double delta[3];
      // One ulp more for the rounding of this product.
      for (int c = 0; c < 3; ++c) delta[c] = unit * dz * std::max(size[c], size[(c + 1) % 3]) * (1 + 0x1p-50);
      if (is_far(Sheared<double>(ray, kz, p), 2 * margin * dz, 2 * reach * dz)) continue;
      const Verdict verdict = decide(
          *this, [&] { return examine<Interval>(ray, kz, p, delta); },
          [&] { return examine<Rational>(ray, kz, p, delta); });
      if (!verdict.is_met && verdict.near_edges == 0) continue;
      Candidate c = {id, verdict.near_edges != 0, verdict.is_met, 0, 0, 0};
      bound_distance(ray, kz, p, unit, c);
      truth.candidates.push_back(c);
      near_edges.push_back(verdict.near_edges);
    }
  }
  cluster_up(ray, kz, truth, near_edges);

  const Candidate *nearest = nullptr;
  for (const Candidate &c : truth.candidates) {
    if (c.is_near || c.t_low < ray.tmin || c.t_high > ray.tmax) continue;
    if (nearest == nullptr) {
      nearest = &c;
      continue;
    }
    const Point p[3] = {mesh_.corner(c.triangle, 0), mesh_.corner(c.triangle, 1),
                        mesh_.corner(c.triangle, 2)};
    const uint32_t n = nearest->triangle;
    const Point q[3] = {mesh_.corner(n, 0), mesh_.corner(n, 1), mesh_.corner(n, 2)};
    const int order = decide(
        *this, [&] { return compare_distances<Interval>(ray, p, q); },
        [&] { return compare_distances<Rational>(ray, p, q); });
    if (order < 0 || (order == 0 && c.triangle < n)) nearest = &c;
  }
  if (nearest != nullptr) truth.nearest = nearest->triangle;
  return truth;
}

void ExactOracle::cluster_up(const gpurt_ray &ray, int kz, RayTruth &truth,
                             const std::vector<uint32_t> &near_edges) const
{
  // Union-find over the candidates, by the near edges that they share.
  std::vector<uint32_t> parent(truth.candidates.size());
  std::iota(parent.begin(), parent.end(), 0u);
  const auto root = [&](uint32_t i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
  };
  std::map<Edge, uint32_t> first_with;
  for (uint32_t i = 0; i < truth.candidates.size(); ++i) {
    const auto &ids = position_[truth.candidates[i].triangle];
    for (int k = 0; k < 3; ++k) {
      if ((near_edges[i] >> k & 1u) == 0) continue;
      const auto [a, b] = std::minmax(ids[k], ids[(k + 1) % 3]);
      const auto [it, is_new] = first_with.try_emplace({a, b}, i);
      if (!is_new) parent[root(i)] = root(it->second);
    }
  }
  // Outline of each cluster: its edges, those that are passed in both directions cancelled.
  struct Directed {
    int count = 0;
    bool is_near = false;
    double angle = 0;  // under which it is seen from the ray, from the smaller position to the larger
  };
  std::map<std::array<uint32_t, 3>, Directed> outline;  // (root, edge)
  std::map<uint32_t, uint32_t> cluster_of;
  for (uint32_t i = 0; i < truth.candidates.size(); ++i) {
    Candidate &c = truth.candidates[i];
    if (!c.is_near) continue;
    const uint32_t r = root(i);
    c.cluster = cluster_of.try_emplace(r, uint32_t(truth.clusters.size())).first->second;
    if (c.cluster == truth.clusters.size()) truth.clusters.emplace_back();
    Cluster &cluster = truth.clusters[c.cluster];
    cluster.t_low = std::min(cluster.t_low, c.t_low);
    cluster.t_high = std::max(cluster.t_high, c.t_high);
    const Point p[3] = {mesh_.corner(c.triangle, 0), mesh_.corner(c.triangle, 1),
                        mesh_.corner(c.triangle, 2)};
    // The outline is not near, so that extended precision tells its angles: their sum is a multiple of a full turn.
    const Sheared<long double> s(ray, kz, p);
    const auto &ids = position_[c.triangle];
    for (int k = 0; k < 3; ++k) {
      const int l = (k + 1) % 3;
      const bool forward = ids[k] < ids[l];
      Directed &e = outline[{r, std::min(ids[k], ids[l]), std::max(ids[k], ids[l])}];
      e.count += forward ? 1 : -1;
      e.is_near = near_edges[i] >> k & 1u;
      const long double angle =
          std::atan2(s.x[k] * s.y[l] - s.y[k] * s.x[l], s.x[k] * s.x[l] + s.y[k] * s.y[l]);
      e.angle = double(forward ? angle : -angle);
    }
  }
  std::vector<double> turn(truth.clusters.size(), 0.0);
  for (const auto &[key, e] : outline) {
    if (e.count == 0) continue;
    const uint32_t cluster = cluster_of[key[0]];
    if (e.is_near) truth.clusters[cluster].is_open = true;
    turn[cluster] += e.count * e.angle;
  }
  for (size_t i = 0; i < turn.size(); ++i) {
    if (!truth.clusters[i].is_open) truth.clusters[i].winding = int(std::lround(turn[i] / 6.283185307179586));
  }
}

}  // namespace gpurt_test
