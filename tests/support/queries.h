// Ray queries and tree exchange in one call, for tests.
#pragma once

#include "gpurt_test.h"

namespace gpurt_test {

/// All crossings of the rays; those of ray i are [offsets[i], offsets[i + 1]).
inline std::vector<gpurt_hit> trace_all(gpurt_scene scene, const std::vector<gpurt_ray> &rays,
                                        std::vector<uint64_t> &offsets)
{
  offsets.assign(rays.size() + 1, 0);
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.query = GPURT_QUERY_ALL;
  desc.num_rays = rays.size();
  desc.rays = rays.data();
  desc.offsets = offsets.data();
  GPURT_EXPECT_OK(gpurt_scene_trace(scene, &desc));
  std::vector<gpurt_hit> hits(offsets.back());
  if (hits.empty()) return hits;
  desc.hits = hits.data();
  desc.hit_capacity = hits.size();
  GPURT_EXPECT_OK(gpurt_scene_trace(scene, &desc));
  return hits;
}

/// Closest hits of a CUDA device by warps that refill, which it takes for large batches alone unless it is told to; what they
/// are written to is the caller's.
inline gpurt_trace_desc by_refilling_warps(const std::vector<gpurt_ray> &rays)
{
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.schedule.traversal = GPURT_TRAVERSAL_STACK;
  desc.schedule.launch = GPURT_LAUNCH_PERSISTENT;
  desc.num_rays = rays.size();
  desc.rays = rays.data();
  return desc;
}

/// The nodes of kd-tree 0 of the last commit.
inline std::vector<gpurt_kdtree_node> exported_nodes(gpurt_scene scene)
{
  gpurt_kdtree tree = GPURT_KDTREE_INIT;
  GPURT_EXPECT_OK(gpurt_scene_export_tree(scene, &tree));
  std::vector<gpurt_kdtree_node> nodes(tree.num_nodes);
  std::vector<uint32_t> references(tree.num_references);
  tree.nodes = nodes.data();
  tree.references = references.data();
  GPURT_EXPECT_OK(gpurt_scene_export_tree(scene, &tree));
  return nodes;
}

inline gpurt_scene_facts facts_of(gpurt_scene scene)
{
  gpurt_scene_facts facts = GPURT_SCENE_FACTS_INIT;
  GPURT_EXPECT_OK(gpurt_scene_get_facts(scene, &facts));
  return facts;
}

}  // namespace gpurt_test
