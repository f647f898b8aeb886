// Builds the lists of photons of a kd-tree's leaves on the host, for every backend.
#pragma once

#include <memory>
#include <vector>

#include "core/photon/node_lists.h"
#include "memory.h"

namespace gpurt {

struct HostNodeLists {
  float radius = 0;
  std::vector<PhotonNode> nodes;
  std::vector<uint32_t> photons;
  Reservation reservation;  // of both

  NodeLists view() const { return {nodes.data(), photons.data()}; }
};

/// Lists for a radius of photons in the order of their grid. Throws OUT_OF_MEMORY, also where lists are longer than
/// their indices reach.
HostNodeLists build_node_lists(const PhotonProbe *probes, uint64_t num_photons, float radius,
                               const std::shared_ptr<MemoryTracker> &memory);

}  // namespace gpurt
