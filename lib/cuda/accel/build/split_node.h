// Splits a node of medium size by one group, from the choice of the split to the children's references.
#pragma once

#include "cuda/accel/build/split.h"

namespace gpurt::cuda {

/// What a group shares while it splits nodes.
struct SplitShared {
  BuildBins bins;
  SplitState state;
  OrderedBox bounds[2], centers[2];
  uint32_t child;
};

/// Both children's bounds as a group gathers them.
template <class Group>
GPURT_GROUP SplitTarget gather_into(const Group &group, SplitShared &shared)
{
  if (group.thread() == 0) {
    for (int s = 0; s < 2; ++s) shared.bounds[s] = shared.centers[s] = empty_ordered_box();
  }
  return {
      {nullptr, nullptr}, {&shared.bounds[0], &shared.bounds[1]}, {&shared.centers[0], &shared.centers[1]}};
}

/// `Spatial` false: leaves the node to others where splits in space are worth a try.
template <bool Spatial, class Group>
GPURT_GROUP void split_node(const Group &group, const BuildLevel &level, uint32_t index, SplitShared &shared)
{
  // Copies: the array of nodes is written to below.
  BuildNode *nodes = level.nodes;
  const uint32_t count = nodes[index].count, spare = nodes[index].spare;
  const OrderedBox bounds = nodes[index].bounds, centers = nodes[index].centers;
  const BuildReference *references = level.from + nodes[index].first;
  SplitState &state = shared.state;
  group.sync();
  clear_bins(group, shared.bins);
  if (group.thread() == 0) begin_split(state, count);
  SplitTarget target = gather_into(group, shared);
  group.sync();
  if (!must_halve(count, nodes[index].depth)) {
    bin_objects(group, references, count, bounds, centers, shared.bins);
    group.sync();
    compare_planes(group, shared.bins, count, false, 0, level.scale, &state.best_object);
    group.sync();
    if (group.thread() == 0)
      take_object_split(state, shared.bins, centers, count, spare, level.scale, level.root_area);
    group.sync();
    if (state.tries_space) {
      if constexpr (!Spatial) {
        if (group.thread() == 0) level.spatial_list[add_to(&level.counters->num_spatial, 1)] = index;
        return;
      } else {
        clear_bins(group, shared.bins);
        group.sync();
        bin_space(group, level.scene, references, count, bounds, shared.bins);
        group.sync();
        compare_planes(group, shared.bins, count, true, spare, level.scale, &state.best_spatial);
        group.sync();
        if (group.thread() == 0) take_spatial_split(state, shared.bins, bounds);
      }
    }
  }
  if (group.thread() == 0) shared.child = make_children(level, index, state.split);
  group.sync();
  BuildNode *children = nodes + shared.child;
  for (int s = 0; s < 2; ++s) target.references[s] = references_of(children[s], level.to, level.small_nodes);
  move_references<Spatial>(group, level.scene, references, count, 0, state.split, target);
  group.sync();
  for (uint32_t s = group.thread(); s < 2; s += group.size()) {
    children[s].bounds = shared.bounds[s];
    children[s].centers = shared.centers[s];
  }
}

}  // namespace gpurt::cuda
