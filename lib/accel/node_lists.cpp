#include "accel/node_lists.h"

#include <algorithm>
#include <limits>

namespace gpurt {
namespace {

// Leaves hold about this many photons, not counting those around; or extend less than the radius: cutting them further
// would hardly make their lists shorter.
constexpr size_t leaf_photons = 32;
constexpr int max_depth = 40;

class Builder {
 public:
  Builder(const PhotonProbe *probes, HostNodeLists &lists, float radius)
      // A little more than the radius, for what distances are rounded by.
      : probes_(probes), lists_(lists), radius_(radius), reach_(double(radius) * (1 + 0x1p-18))
  {}

  // `inside` lie in the node's cell, `near` within the radius of it, inside included.
  void build(uint32_t node, std::vector<uint32_t> inside, std::vector<uint32_t> near, int depth)
  {
    Box box = empty_box();
    for (const uint32_t i : inside) box = extend(box, probes_[i].position);
    const Vec3f extent = inside.empty() ? Vec3f{0, 0, 0} : box.hi - box.lo;
    const int axis = extent.x >= extent.y && extent.x >= extent.z ? 0 : (extent.y >= extent.z ? 1 : 2);
    if (inside.size() <= leaf_photons || !(at(extent, axis) > radius_) || depth == max_depth) {
      add_leaf(node, near);
      return;
    }
    // The median, but for coordinates that many photons share: some lie below in any case.
    std::vector<float> coordinates;
    for (const uint32_t i : inside) coordinates.push_back(at(probes_[i].position, axis));
    std::nth_element(coordinates.begin(), coordinates.begin() + ptrdiff_t(coordinates.size() / 2),
                     coordinates.end());
    float split = coordinates[coordinates.size() / 2];
    if (!(split > at(box.lo, axis))) split = next_up(at(box.lo, axis));
    const auto select = [&](const std::vector<uint32_t> &from, auto &&wanted) {
      std::vector<uint32_t> selected;
      for (const uint32_t i : from) {
        if (wanted(at(probes_[i].position, axis))) selected.push_back(i);
      }
      return selected;
    };
    const uint32_t child = uint32_t(lists_.nodes.size());
    lists_.nodes.resize(child + 2);
    lists_.nodes[node] = {split, uint32_t(axis), child, 0};
    build(child, select(inside, [=](float x) { return x < split; }),
          select(near, [&](float x) { return double(x) < double(split) + reach_; }), depth + 1);
    std::vector<uint32_t> above = select(inside, [=](float x) { return x >= split; });
    std::vector<uint32_t> near_above =
        select(near, [&](float x) { return double(x) > double(split) - reach_; });
    inside = {};
    near = {};
    build(child + 1, std::move(above), std::move(near_above), depth + 1);
  }

 private:
  void add_leaf(uint32_t node, const std::vector<uint32_t> &near)
  {
    const uint64_t first = lists_.photons.size();
    if (first + near.size() > std::numeric_limits<uint32_t>::max()) {
      fail(GPURT_ERROR_OUT_OF_MEMORY,
           "lists of photons within {:g} of a kd-tree's leaves have more than 2^32 entries; use "
           "GPURT_GATHER_GRID, or a "
           "smaller radius",
           radius_);
    }
    if (first + near.size() > lists_.photons.capacity()) {
      const uint64_t capacity = std::max<uint64_t>(first + near.size(), 2 * lists_.photons.capacity());
      lists_.reservation.resize(capacity * sizeof(uint32_t) + lists_.nodes.size() * sizeof(PhotonNode),
                                "lists of photons");
      lists_.photons.reserve(capacity);
    }
    lists_.photons.insert(lists_.photons.end(), near.begin(), near.end());
    lists_.nodes[node] = {0, 3, uint32_t(first), uint32_t(near.size())};
  }

  const PhotonProbe *probes_;
  HostNodeLists &lists_;
  const float radius_;
  const double reach_;
};

}  // namespace

HostNodeLists build_node_lists(const PhotonProbe *probes, uint64_t num_photons, float radius,
                               const std::shared_ptr<MemoryTracker> &memory)
{
  HostNodeLists lists;
  lists.radius = radius;
  lists.reservation = Reservation(memory, 0, "lists of photons");
  // What the levels of the recursion hold: half as much each.
  const Reservation working(memory, 4 * num_photons * sizeof(uint32_t), "lists of photons");
  lists.nodes.resize(1);
  std::vector<uint32_t> all(num_photons);
  for (uint64_t i = 0; i < num_photons; ++i) all[i] = uint32_t(i);
  Builder(probes, lists, radius).build(0, all, all, 0);
  return lists;
}

}  // namespace gpurt
