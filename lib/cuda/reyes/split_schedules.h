// The schedules of stage 'split' beside the one of rounds (stages.h).
#pragma once

#include <functional>

#include "cuda/reyes/stages.h"

namespace gpurt::cuda {

/// What the stages have counted so far: waits for the stream.
using ReadNumbers = std::function<ReyesNumbers()>;

/// Cuts pieces until none wait, or until the list of those that are to be diced is full: level by level.
void split_by_levels(const ReyesBatch &batch, const ReadNumbers &read, cudaStream_t stream);

/// The same by blocks that have queues of their own. `turn` counts launches of the batch's memory, from 1 on; `ready`:
/// numbers as many as the stack has places, which were zero before turn 1; `last`: what was counted after the last launch
/// of the batch, null for the first one. False: there is no room for what waits and for what blocks may leave besides; nothing is
/// done.
bool split_by_queues(const ReyesBatch &batch, uint32_t *ready, uint32_t turn, const ReyesNumbers *last,
                     cudaStream_t stream);

/// Makes a stack, as launch_split takes it, of what the launch `turn` of queues left.
void stack_queues(const ReyesBatch &batch, uint32_t turn, const ReyesNumbers &last, cudaStream_t stream);

}  // namespace gpurt::cuda
