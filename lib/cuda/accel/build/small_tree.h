// The subtree of a small node, by one warp: all parts of a level are split at once, each at the best of all planes between
// its references' centres.
//
// Parts are runs of places. Along every axis, the places of a part hold its references in the order of their centres, which
// is found once and kept as parts are split, so that a sweep from either end of a part gives the boxes on both sides of all of
// its planes. Nodes come level by level, in the order of their parts.
//
// Source: Wald 2007, sweep SAH; the order that is kept: Wald and Havran 2006.
#pragma once

#include "core/accel/bvh_node.h"
#include "cuda/accel/build/build_node.h"

namespace gpurt::cuda {

struct SmallTree {
  BuildReference references[small_size];
  int center[3][small_size];  // as ordered integers
  uint8_t order[2][3]
               [small_size];  // the references that places hold, along each axis; of this level and the next
  struct Place {
    uint8_t begin, end;  // the part's places
    uint8_t parent;      // node * 2 + child that the part is; 0xff: the root
    bool is_leaf;
  } places[small_size];
  // Along one axis: of the part's references up to the place's own, and of those behind it.
  Box below[small_size], above[small_size];
  // The cheapest plane of the three that lie behind the place, and the boxes on both of its sides.
  float cost[small_size];
  uint8_t axis[small_size];
  Box best_below[small_size], best_above[small_size];
  float area[small_size];    // of the part that begins here
  uint8_t last[small_size];  // place of the first child of the part, if it is split
  bool is_halved[small_size];
  bool is_first[small_size];    // whether a reference goes to the first child
  uint32_t first_places[3];     // bits of places that hold such a reference, along each axis
  uint32_t split_parts;         // bits of the places where parts begin that are split
  uint32_t longest[2];          // places of the largest part that is no leaf; of this level and the next
  float part_cost[small_size];  // of nodes and leaves that begin here, over all levels
  uint32_t num_nodes, height;
};

GPURT_GROUP uint32_t bits_below(uint32_t place) { return (1u << place) - 1u; }

GPURT_GROUP Box box_at(const SmallTree &s, const uint8_t *order, uint32_t place)
{
  const BuildReference &r = s.references[order[place]];
  return {r.lo, r.hi};
}

#if defined(__CUDACC__)

GPURT_GROUP Box united(const Box &a, const Box &b)
{
  return {{fminf(a.lo.x, b.lo.x), fminf(a.lo.y, b.lo.y), fminf(a.lo.z, b.lo.z)},
          {fmaxf(a.hi.x, b.hi.x), fmaxf(a.hi.y, b.hi.y), fmaxf(a.hi.z, b.hi.z)}};
}
template <class Shuffle>
GPURT_GROUP Box shuffled(const Box &b, Shuffle &&shuffle)
{
  return {{shuffle(b.lo.x), shuffle(b.lo.y), shuffle(b.lo.z)},
          {shuffle(b.hi.x), shuffle(b.hi.y), shuffle(b.hi.z)}};
}

/// Finds below and above of all places. The whole group comes here.
GPURT_GROUP void sweep_parts(const WarpGroup &group, SmallTree &s, const uint8_t *order, uint32_t count,
                             uint32_t longest)
{
  const uint32_t p = group.thread();
  const bool is_place = p < count;
  const uint32_t begin = is_place ? s.places[p].begin : p, end = is_place ? s.places[p].end : p + 1;
  const Box own = is_place ? box_at(s, order, p) : empty_box();
  Box below = own, from_here = own;
  for (uint32_t step = 1; step < longest; step *= 2) {
    const Box before = shuffled(below, [&](float x) { return __shfl_up_sync(~0u, x, step); }),
              behind = shuffled(from_here, [&](float x) { return __shfl_down_sync(~0u, x, step); });
    if (p >= begin + step) below = united(below, before);
    if (p + step < end) from_here = united(from_here, behind);
  }
  const Box above = shuffled(from_here, [](float x) { return __shfl_down_sync(~0u, x, 1); });
  if (!is_place) return;
  s.below[p] = below;
  s.above[p] = p + 1 < end ? above : empty_box();
}

#else

inline void sweep_parts(const SerialGroup &, SmallTree &s, const uint8_t *order, uint32_t count, uint32_t)
{
  for (uint32_t p = 0; p < count; ++p) {
    const Box own = box_at(s, order, p);
    s.below[p] = p == s.places[p].begin ? own : extend(s.below[p - 1], own);
  }
  for (uint32_t p = count; p-- != 0;)
    s.above[p] = p + 1 == s.places[p].end ? empty_box() : extend(s.above[p + 1], box_at(s, order, p + 1));
}

#endif

/// Along every axis, the order of the references' centres.
template <class Group>
GPURT_GROUP void sort_references(const Group &group, SmallTree &s, uint32_t count)
{
  for (uint32_t i = group.thread(); i < count; i += group.size()) {
    const int x = s.center[0][i], y = s.center[1][i], z = s.center[2][i];
    uint32_t rank[3] = {0, 0, 0};
    const auto comes_before = [&](int a, uint32_t j, int b) { return a < b || (a == b && j < i); };
    for (uint32_t j = 0; j < count; ++j) {
      rank[0] += comes_before(s.center[0][j], j, x);
      rank[1] += comes_before(s.center[1][j], j, y);
      rank[2] += comes_before(s.center[2][j], j, z);
    }
    for (int k = 0; k < 3; ++k) s.order[0][k][rank[k]] = uint8_t(i);
  }
}

/// What planes along an axis cost, once below and above are there.
template <class Group>
GPURT_GROUP void compare_places(const Group &group, SmallTree &s, uint32_t axis, uint32_t count, float scale)
{
  for (uint32_t p = group.thread(); p < count; p += group.size()) {
    const uint32_t begin = s.places[p].begin, end = s.places[p].end;
    if (axis == 0) {
      s.cost[p] = infinity;
      s.axis[p] = 0;
      if (p == begin) s.area[p] = scaled_half_area(s.below[end - 1], scale);
    }
    if (s.places[p].is_leaf || p + 1 == end) continue;
    const Box below = s.below[p], above = s.above[p];
    const float cost = scaled_half_area(below, scale) * float(p + 1 - begin) +
                       scaled_half_area(above, scale) * float(end - p - 1);
    if (!(cost < s.cost[p])) continue;
    s.cost[p] = cost;
    s.axis[p] = uint8_t(axis);
    s.best_below[p] = below;
    s.best_above[p] = above;
  }
}

/// Decides which parts are split and where their references go.
template <class Group>
GPURT_GROUP void choose_planes(const Group &group, SmallTree &s, const uint8_t (&order)[3][small_size],
                               uint32_t count, uint32_t depth)
{
  for (uint32_t p = group.thread(); p < count; p += group.size()) {
    if (s.places[p].is_leaf) continue;
    const uint32_t begin = s.places[p].begin, end = s.places[p].end, n = end - begin;
    uint32_t best = begin;
    float least = s.cost[begin];
    for (uint32_t j = begin + 1; j < end; ++j) {
      if (!(s.cost[j] < least)) continue;
      best = j;
      least = s.cost[j];
    }
    const float area = s.area[begin];
    if (n == 1 || (n <= bvh_max_leaf_size && area * float(n) <= area * build_traversal_cost + least))
      continue;
    const bool is_halved = must_halve(n, depth) || !(least < infinity);
    const uint32_t last = is_halved ? begin + n / 2 - 1 : best;
    s.last[p] = uint8_t(last);
    s.is_halved[p] = is_halved;
    s.is_first[order[is_halved ? 0 : s.axis[best]][p]] = p <= last;
    if (p == begin) set_bits(&s.split_parts, 1u << p);
  }
}

/// Writes nodes, whose children's words count from the subtree's first node and reference, and the references' triangles.
template <class Group>
GPURT_GROUP void build_small(const Group &group, const BuildReference *from, BuildNode &node, float scale,
                             const BvhFrame &frame, SmallTree &s, BvhNode *nodes, uint32_t *triangles)
{
  const uint32_t count = node.count;
  for (uint32_t i = group.thread(); i < count; i += group.size()) {
    const BuildReference r = load_reference(from + i);
    s.references[i] = r;
    const Vec3f center = center_of(r);
    for (int k = 0; k < 3; ++k) s.center[k][i] = ordered_from_float(at(center, k));
    s.places[i] = {0, uint8_t(count), 0xff, false};
    s.part_cost[i] = 0;
  }
  if (group.thread() == 0) {
    s.num_nodes = s.height = 0;
    s.longest[0] = count;
  }
  group.sync();
  sort_references(group, s, count);
  group.sync();
  for (uint32_t level = 0;; ++level) {
    const uint32_t now = level % 2, next = now ^ 1;
    const auto &order = s.order[now];
    const uint32_t longest = s.longest[now];
    if (group.thread() == 0) {
      s.split_parts = s.longest[next] = 0;
      for (uint32_t &places : s.first_places) places = 0;
    }
    for (uint32_t k = 0; k < 3; ++k) {
      sweep_parts(group, s, order[k], count, longest);
      group.sync();
      compare_places(group, s, k, count, scale);
      group.sync();
    }
    choose_planes(group, s, order, count, node.depth + level);
    group.sync();
    const uint32_t split_parts = s.split_parts;
    const auto is_split = [&](uint32_t p) { return (split_parts >> s.places[p].begin & 1u) != 0; };
    for (uint32_t p = group.thread(); p < count; p += group.size()) {
      if (!is_split(p)) continue;
      for (uint32_t k = 0; k < 3; ++k) {
        if (s.is_first[order[k][p]]) set_bits(&s.first_places[k], 1u << p);
      }
    }
    group.sync();
    // Places and nodes of the next level.
    const uint32_t first_node = s.num_nodes;
    for (uint32_t p = group.thread(); p < count; p += group.size()) {
      const SmallTree::Place place = s.places[p];
      const uint32_t begin = place.begin, end = place.end;
      const auto link = [&](uint32_t word) {
        if (place.parent == 0xff) return;
        BvhNode &parent = nodes[place.parent / 2];
        (place.parent % 2 == 0 ? parent.child0 : parent.child1) = word;
      };
      if (!is_split(p)) {
        for (uint32_t k = 0; k < 3; ++k) s.order[next][k][p] = order[k][p];
        if (place.is_leaf) continue;
        s.places[p].is_leaf = true;
        triangles[p] = s.references[order[0][p]].triangle;
        if (p != begin) continue;
        s.part_cost[p] += s.area[p] * float(end - begin);
        link(bvh_leaf(begin, end - begin));
        continue;
      }
      const uint32_t last = s.last[p], middle = last + 1;
      for (uint32_t k = 0; k < 3; ++k) {
        const uint32_t r = order[k][p];
        const uint32_t num_first =
            count_bits(s.first_places[k] & bits_below(p) & ~bits_below(begin));  // before this place
        s.order[next][k][s.is_first[r] ? begin + num_first : middle + (p - begin - num_first)] = uint8_t(r);
      }
      Box box[2] = {s.best_below[last], s.best_above[last]};
      if (s.is_halved[p]) {
        box[0] = box[1] = empty_box();
        for (uint32_t j = begin; j < end; ++j) box[j > last] = extend(box[j > last], box_at(s, order[0], j));
      }
      // The child with the larger box comes first: where the order does not matter, it is met more often.
      const bool is_swapped = scaled_half_area(box[1], scale) > scaled_half_area(box[0], scale);
      // Parts that are split before this one have the nodes before this one's.
      const uint32_t index = first_node + count_bits(split_parts & bits_below(begin));
      const bool is_first = p <= last;
      s.places[p] = {uint8_t(is_first ? begin : middle), uint8_t(is_first ? middle : end),
                     uint8_t(index * 2 + (is_first == is_swapped ? 1 : 0)), false};
      if (p != begin) continue;
      raise_to(&s.longest[next], max(middle - begin, end - middle));
      nodes[index] = make_bvh_node(box[is_swapped], 0, box[!is_swapped], 0, frame);
      s.part_cost[p] += s.area[p] * build_traversal_cost;
      link(index);
    }
    group.sync();
    if (split_parts == 0) break;
    if (group.thread() == 0) {
      s.num_nodes = first_node + count_bits(split_parts);
      s.height = level + 1;
    }
  }
  if (group.thread() == 0) {
    float cost = 0;
    for (uint32_t i = 0; i < count; ++i) cost += s.part_cost[i];
    node.cost = cost;
    node.num_inner = s.num_nodes;
    node.num_references = count;
    node.height = s.height;
  }
}

}  // namespace gpurt::cuda
