// Ray batches on a CUDA device: host arrays travel through pinned chunks, device arrays are used where they are.
#pragma once

#include "backend.h"
#include "cuda/accel/kernels.h"
#include "cuda/accel/ray_slices.h"
#include "cuda/lanes.h"

namespace gpurt::cuda {

/// What a batch runs on.
struct QueryContext {
  const TraceScene &scene;
  const std::shared_ptr<DeviceMemory> &memory;
  LanePool &lanes;
  SliceSize &slice;
};

/// Answers one request. Throws INVALID_ARGUMENT for pointers that do not fit the storage and for too small a room for
/// all hits; OUT_OF_MEMORY; DEVICE. The device must be current.
void trace_batch(const QueryContext &context, const TraceRequest &request);

/// Queues closest or any hits of rays in device memory on the caller's stream and returns: after `wait_event`, before
/// `done_event`, where these are not null. Throws as trace_batch, and UNSUPPORTED for all hits.
void queue_batch(const QueryContext &context, const TraceRequest &request, cudaStream_t stream,
                 cudaEvent_t wait_event, cudaEvent_t done_event);

}  // namespace gpurt::cuda
