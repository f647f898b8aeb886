// The device's builder of bvhs, run by one thread on the host: the same algorithms (lib/cuda/accel/build), level by level.
#pragma once

#include "accel/bvh_build.h"
#include "core/accel/degenerate.h"
#include "cuda/accel/build/place.h"
#include "cuda/accel/build/small_tree.h"
#include "cuda/accel/build/split_node.h"

namespace gpurt::test {

inline HostBvh build_serially(const std::vector<Vec3f> &positions, const std::vector<UInt3> &triangles,
                              uint32_t spare, BvhBuildStats &stats)
{
  using namespace gpurt::cuda;
  stats = {};
  HostBvh tree;
  const SerialGroup group;
  BuildCounters counters{};
  counters.bounds = counters.centers = empty_ordered_box();
  std::vector<BuildReference> now, next;
  for (uint32_t i = 0; i < triangles.size(); ++i) {
    const UInt3 c = triangles[i];
    const Vec3f a = positions[c.x], b = positions[c.y], d = positions[c.z];
    if (has_no_area(a, b, d)) continue;
    const BuildReference r = {min(a, min(b, d)), i, max(a, max(b, d)), 0};
    now.push_back(r);
    extend_shared(counters.bounds, {r.lo, r.hi});
    extend_shared(counters.centers, {center_of(r), center_of(r)});
  }
  const uint32_t count = uint32_t(now.size());
  if (count == 0) return tree;
  const uint32_t most = count + spare;
  now.resize(most);
  next.resize(most);
  tree.bounds = box_of(counters.bounds);
  tree.frame = make_bvh_frame(tree.bounds);
  const float scale = area_scale(tree.bounds), root_area = scaled_half_area(tree.bounds, scale);
  const BuildScene scene = {positions.data(), triangles.data()};
  std::vector<BuildNode> nodes(2 * size_t(most));
  std::vector<BvhNode> small_nodes(most);
  std::vector<uint32_t> small_references(most);
  std::vector<uint32_t> lists[2][4], spatial(most);
  BuildLevel level{};
  level.scene = scene;
  level.nodes = nodes.data();
  level.spatial_list = spatial.data();
  level.small_nodes = small_nodes.data();
  level.small_references = small_references.data();
  level.counters = &counters;
  level.scale = scale;
  level.root_area = root_area;
  level.frame = tree.frame;
  nodes[0] = {};
  nodes[0].bounds = counters.bounds;
  nodes[0].centers = counters.centers;
  nodes[0].count = count;
  nodes[0].spare = spare;
  nodes[0].child = invalid_id;
  counters.num_nodes = 1;
  for (auto &side : lists) {
    for (auto &list : side) list.resize(most);
  }
  if (class_of(count) == SmallNode) {
    counters.num_small_references = count;
    std::copy_n(now.data(), count, references_of(nodes[0], nullptr, small_nodes.data()));
  }
  for (uint32_t begin = 0, parity = 0; begin < counters.num_nodes; parity ^= 1) {
    const uint32_t end = counters.num_nodes;
    counters.num_level_references = counters.num_spatial = 0;
    for (uint32_t &n : counters.num_of_class) n = 0;
    level.from = now.data();
    level.to = next.data();
    for (uint32_t c = 0; c < 4; ++c) level.next_list[c] = lists[parity][c].data();
    for (uint32_t i = begin; i < end; ++i) {
      SplitShared shared;
      if (nodes[i].count > small_size) split_node<false>(group, level, i, shared);
    }
    for (uint32_t i = 0; i < counters.num_spatial; ++i) {
      SplitShared shared;
      split_node<true>(group, level, spatial[i], shared);
    }
    std::swap(now, next);
    begin = end;
  }
  for (uint32_t i = 0; i < counters.num_nodes; ++i) {
    SmallTree shared;
    if (is_small(nodes[i])) {
      build_small(group, references_of(nodes[i], nullptr, small_nodes.data()), nodes[i], scale, tree.frame,
                  shared, small_nodes.data() + nodes[i].subtree, small_references.data() + nodes[i].subtree);
    }
  }
  for (uint32_t i = counters.num_nodes; i-- != 0;) sum_up(nodes.data(), i, scale);
  tree.nodes.resize(nodes[0].num_inner);
  tree.references.resize(nodes[0].num_references);
  const BuildTarget target = {tree.nodes.data(), tree.references.data()};
  for (uint32_t i = 0; i < counters.num_nodes; ++i) {
    place_children(nodes.data(), i, scale, tree.frame, target);
    if (is_small(nodes[i])) place_small(group, nodes[i], small_nodes.data(), small_references.data(), target);
  }
  tree.root = word_of(nodes[0]);
  stats.depth = nodes[0].height;
  stats.sah_cost = root_area > 0 ? double(nodes[0].cost) / root_area : 0;
  return tree;
}

}  // namespace gpurt::test
