// Batches of queries of a photon map: slices that are sorted and answered one after another.
#pragma once

#include "cuda/lanes.h"
#include "cuda/photon/kernels.h"
#include "photon_maps.h"

namespace gpurt::cuda {

/// What queries run on.
struct PhotonQueryContext {
  const PhotonLevels &levels;
  const PhotonGrid &grid;  // for ranges
  const NodeLists *lists;  // in place of its cells; or null
  const std::shared_ptr<DeviceMemory> &memory;
};

/// Answers a query whose arrays are device memory, on the lane, and waits.
void query_device_memory(const PhotonQueryContext &context, const PhotonQuery &query, Lane &lane);
/// Answers a query whose arrays are host memory.
void query_host_memory(const PhotonQueryContext &context, const PhotonQuery &query, Lane &lane);
/// Queues a query of counts, sums or nearest points, whose arrays are device memory.
void queue_query(const PhotonQueryContext &context, const PhotonQuery &query, cudaStream_t stream);

}  // namespace gpurt::cuda
