#include "cgal_tree.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Kd_tree.h>
#include <CGAL/Search_traits_3.h>
#include <CGAL/Splitters.h>
#include <CGAL/intersections.h>

namespace gpurt_test {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Traits = CGAL::Search_traits_3<Kernel>;

Kernel::Point_3 point(const Point &p) { return {p[0], p[1], p[2]}; }

struct Cell {
  Point lo, hi;
};

// Copies CGAL's nodes in preorder and hands triangles down.
template <class Tree>
class Converter {
 public:
  Converter(const Mesh &mesh, ExchangeTree &out) : out_(out)
  {
    for (size_t i = 0; i < mesh.triangles.size(); ++i) {
      const Point p[3] = {mesh.corner(i, 0), mesh.corner(i, 1), mesh.corner(i, 2)};
      triangles_.emplace_back(point(p[0]), point(p[1]), point(p[2]));
      Cell box{p[0], p[0]};
      for (int k = 0; k < 3; ++k) {
        box.lo[k] = std::min({p[0][k], p[1][k], p[2][k]});
        box.hi[k] = std::max({p[0][k], p[1][k], p[2][k]});
      }
      boxes_.push_back(box);
    }
  }

  void convert(typename Tree::Node_const_handle from, uint32_t to, const Cell &cell,
               const std::vector<uint32_t> &ids, uint32_t depth)
  {
    out_.depth = std::max(out_.depth, depth);
    if (from->is_leaf()) {
      out_.nodes[to] = {uint32_t(out_.references.size()), uint32_t(ids.size()) << 2 | 3u};
      out_.references.insert(out_.references.end(), ids.begin(), ids.end());
      return;
    }
    const auto inner = static_cast<typename Tree::Internal_node_const_handle>(from);
    const int axis = int(inner->cutting_dimension());
    // Rounding is monotonic, so a cut between points of a cell stays in the closed cell.
    const float plane = std::clamp(float(inner->cutting_value()), cell.lo[axis], cell.hi[axis]);
    const uint32_t child = uint32_t(out_.nodes.size());
    out_.nodes.resize(child + 2);
    uint32_t word;
    std::memcpy(&word, &plane, sizeof word);
    out_.nodes[to] = {word, child << 2 | uint32_t(axis)};
    Cell below = cell, above = cell;
    below.hi[axis] = plane;
    above.lo[axis] = plane;
    convert(inner->lower(), child, below, touching(ids, below), depth + 1);
    convert(inner->upper(), child + 1, above, touching(ids, above), depth + 1);
  }

 private:
  // Exact: the inexact kernel's predicates are. Boxes decide where they can, they are exact too.
  std::vector<uint32_t> touching(const std::vector<uint32_t> &ids, const Cell &cell) const
  {
    const Kernel::Iso_cuboid_3 cuboid(point(cell.lo), point(cell.hi));
    std::vector<uint32_t> out;
    for (uint32_t id : ids) {
      const Cell &box = boxes_[id];
      bool is_apart = false, is_within = true;
      for (int k = 0; k < 3; ++k) {
        is_apart = is_apart || box.hi[k] < cell.lo[k] || box.lo[k] > cell.hi[k];
        is_within = is_within && box.lo[k] >= cell.lo[k] && box.hi[k] <= cell.hi[k];
      }
      if (!is_apart && (is_within || CGAL::do_intersect(triangles_[id], cuboid))) out.push_back(id);
    }
    return out;
  }

  ExchangeTree &out_;
  std::vector<Kernel::Triangle_3> triangles_;
  std::vector<Cell> boxes_;
};

template <class Splitter>
void build(const Mesh &mesh, const std::vector<Kernel::Point_3> &points, const Splitter &splitter,
           const std::vector<uint32_t> &ids, ExchangeTree &out)
{
  using Tree = CGAL::Kd_tree<Traits, Splitter>;
  Tree tree(points.begin(), points.end(), splitter);
  tree.build();
  out.nodes.resize(1);
  Converter<Tree> converter(mesh, out);
  converter.convert(typename Tree::Node_const_handle(tree.root()), 0, {out.bounds.lo, out.bounds.hi}, ids, 0);
}

}  // namespace

ExchangeTree build_cgal_tree(const Mesh &mesh, TreePoints points, TreeCut cut, unsigned bucket_size,
                             const std::function<bool(uint32_t)> &is_dropped)
{
  ExchangeTree out;
  out.bounds = bounds_of(mesh);
  std::vector<uint32_t> ids;
  for (uint32_t i = 0; i < mesh.triangles.size(); ++i) {
    if (!is_dropped || !is_dropped(i)) ids.push_back(i);
  }
  std::set<Kernel::Point_3> distinct;
  if (points == TreePoints::Vertices) {
    for (const Point &v : mesh.vertices) distinct.insert(point(v));
  } else {
    for (size_t i = 0; i < mesh.triangles.size(); ++i) {
      distinct.insert(
          CGAL::centroid(point(mesh.corner(i, 0)), point(mesh.corner(i, 1)), point(mesh.corner(i, 2))));
    }
  }
  const std::vector<Kernel::Point_3> all(distinct.begin(), distinct.end());
  if (cut == TreeCut::Median) build(mesh, all, CGAL::Median_of_max_spread<Traits>(bucket_size), ids, out);
  else build(mesh, all, CGAL::Sliding_midpoint<Traits>(bucket_size), ids, out);
  return out;
}

}  // namespace gpurt_test
