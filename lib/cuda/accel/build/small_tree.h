// The subtree of a small node, by one warp: all parts of a level are split at once, each at the best of all planes between
// its references' centres.
//
// References stay where they are in shared memory; a part is a run of places, and each place tells whose reference it holds.
// Nodes come level by level, in the order of their parts.
#pragma once

#include "core/accel/bvh_node.h"
#include "cuda/accel/build/build_node.h"

namespace gpurt::cuda {

struct SmallTree {
  BuildReference references[small_size];
  struct Place {
    uint8_t reference, begin, end;  // the part's places
    uint8_t parent;                 // node * 2 + child that the part is; 0xff: the root
    bool is_leaf;
  } places[2][small_size];
  // The best plane that a place offers: all references up to its own, along `axis`, go to the first child.
  float cost[small_size];
  float area[small_size];  // of the part
  uint8_t axis[small_size];
  bool is_split[small_size];  // the part that the place belongs to
  bool is_first[small_size];
  float part_cost[small_size];  // of nodes and leaves that begin here, over all levels
  uint32_t num_nodes, height;
  uint32_t is_done;
};

GPURT_GROUP bool comes_before(float a, uint32_t i, float b, uint32_t j) { return a < b || (a == b && i < j); }

/// Writes nodes, whose children's words count from the subtree's first node and reference, and the references' triangles.
template <class Group>
GPURT_GROUP void build_small(const Group &group, const BuildReference *from, BuildNode &node, float scale,
                             const BvhFrame &frame, SmallTree &s, BvhNode *nodes, uint32_t *triangles)
{
  const uint32_t count = node.count, depth = node.depth;
  for (uint32_t i = group.thread(); i < count; i += group.size()) {
    s.references[i] = load_reference(from + i);
    s.places[0][i] = {uint8_t(i), 0, uint8_t(count), 0xff, false};
    s.part_cost[i] = 0;
  }
  if (group.thread() == 0) s.num_nodes = s.height = 0;
  group.sync();
  uint32_t now = 0;
  for (uint32_t level = 0;; ++level, now ^= 1) {
    const auto &places = s.places[now];
    const auto reference_at = [&](uint32_t i) -> const BuildReference & {
      return s.references[places[i].reference];
    };
    // What every place offers.
    for (uint32_t i = group.thread(); i < count; i += group.size()) {
      const uint32_t begin = places[i].begin, end = places[i].end, n = end - begin;
      s.cost[i] = infinity;
      s.axis[i] = 0;
      if (places[i].is_leaf) continue;
      const Vec3f own = center_of(reference_at(i));
      Box below[3] = {empty_box(), empty_box(), empty_box()},
          above[3] = {empty_box(), empty_box(), empty_box()};
      uint32_t num[3] = {0, 0, 0};
      for (uint32_t j = begin; j < end; ++j) {
        const BuildReference &r = reference_at(j);
        const Box box = {r.lo, r.hi};
        const Vec3f other = center_of(r);
        GPURT_UNROLL
        for (int k = 0; k < 3; ++k) {
          if (j == i || comes_before(at(other, k), j, at(own, k), i)) {
            below[k] = extend(below[k], box);
            ++num[k];
          } else {
            above[k] = extend(above[k], box);
          }
        }
      }
      GPURT_UNROLL
      for (int k = 0; k < 3; ++k) {
        if (num[k] == n) continue;
        const float cost = scaled_half_area(below[k], scale) * float(num[k]) +
                           scaled_half_area(above[k], scale) * float(n - num[k]);
        if (cost < s.cost[i]) {
          s.cost[i] = cost;
          s.axis[i] = uint8_t(k);
        }
      }
      const Box all = extend(below[0], above[0]);
      s.area[i] = scaled_half_area(all, scale);
    }
    if (group.thread() == 0) s.is_done = 1;
    group.sync();
    // The part's best one, which all of its places agree on.
    const auto best_of = [&](uint32_t begin, uint32_t end) {
      uint32_t best = begin;
      for (uint32_t j = begin + 1; j < end; ++j) {
        if (s.cost[j] < s.cost[best] || (s.cost[j] == s.cost[best] && s.axis[j] < s.axis[best])) best = j;
      }
      return best;
    };
    const auto becomes_leaf = [&](uint32_t begin, uint32_t end, float best_cost) {
      const uint32_t n = end - begin;
      return n == 1 || (n <= bvh_max_leaf_size &&
                        s.area[begin] * float(n) <= s.area[begin] * build_traversal_cost + best_cost);
    };
    const auto is_halved = [&](uint32_t n, uint32_t best) {
      return must_halve(n, depth + level) || !(s.cost[best] < infinity);
    };
    for (uint32_t i = group.thread(); i < count; i += group.size()) {
      const uint32_t begin = places[i].begin, end = places[i].end;
      s.is_split[i] = s.is_first[i] = false;
      if (places[i].is_leaf) continue;
      const uint32_t best = best_of(begin, end);
      if (becomes_leaf(begin, end, s.cost[best])) continue;
      s.is_split[i] = true;
      if (is_halved(end - begin, best)) {
        s.is_first[i] = i - begin < (end - begin) / 2;
      } else {
        const int k = s.axis[best];
        s.is_first[i] = i == best || comes_before(at(center_of(reference_at(i)), k), i,
                                                  at(center_of(reference_at(best)), k), best);
      }
    }
    group.sync();
    // Places and nodes of the next level.
    const uint32_t first_node = s.num_nodes;
    auto &next = s.places[now ^ 1];
    for (uint32_t i = group.thread(); i < count; i += group.size()) {
      const auto place = places[i];
      const uint32_t begin = place.begin, end = place.end;
      if (!s.is_split[i]) {
        next[i] = place;
        if (place.is_leaf) continue;
        next[i].is_leaf = true;
        triangles[i] = reference_at(i).triangle;
        if (i != begin) continue;
        s.part_cost[i] += s.area[begin] * float(end - begin);
        if (place.parent != 0xff) {
          BvhNode &parent = nodes[place.parent / 2];
          (place.parent % 2 == 0 ? parent.child0 : parent.child1) = bvh_leaf(begin, end - begin);
        }
        continue;
      }
      // Parts that are split before this one have the nodes before this one's.
      uint32_t index = first_node;
      for (uint32_t b = 0; b < begin; b = places[b].end) index += s.is_split[b];
      uint32_t num_first = 0, rank = 0;  // of this place among those of its side
      for (uint32_t j = begin; j < end; ++j) {
        if (j < i && s.is_first[j] == s.is_first[i]) ++rank;
        num_first += s.is_first[j];
      }
      Box box[2] = {empty_box(), empty_box()};
      for (uint32_t j = begin; j < end; ++j) {
        const BuildReference &r = reference_at(j);
        Box &side = box[s.is_first[j] ? 0 : 1];
        side = extend(side, Box{r.lo, r.hi});
      }
      // The child with the larger box comes first: where the order does not matter, it is met more often.
      const bool is_swapped = scaled_half_area(box[1], scale) > scaled_half_area(box[0], scale);
      const uint32_t middle = begin + num_first;
      next[s.is_first[i] ? begin + rank : middle + rank] = {
          place.reference, uint8_t(s.is_first[i] ? begin : middle), uint8_t(s.is_first[i] ? middle : end),
          uint8_t(index * 2 + (s.is_first[i] == is_swapped ? 1 : 0)), false};
      if (i != begin) continue;
      nodes[index] = make_bvh_node(box[is_swapped], 0, box[!is_swapped], 0, frame);
      s.part_cost[i] += s.area[begin] * build_traversal_cost;
      if (place.parent != 0xff) {
        BvhNode &parent = nodes[place.parent / 2];
        (place.parent % 2 == 0 ? parent.child0 : parent.child1) = index;
      }
      s.is_done = 0;
    }
    group.sync();
    if (group.thread() == 0) {
      uint32_t num_split = 0;
      for (uint32_t b = 0; b < count; b = places[b].end) num_split += s.is_split[b];
      s.num_nodes += num_split;
      if (num_split != 0) s.height = level + 1;
    }
    const bool is_done = s.is_done != 0;
    group.sync();
    if (is_done) break;
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
