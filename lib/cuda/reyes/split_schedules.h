// The schedules of stage 'split' beside the one of rounds (stages.h).
#pragma once

#include <functional>

#include "cuda/layout.h"
#include "cuda/path/place.h"
#include "cuda/reyes/stages.h"

namespace gpurt::cuda {

/// What the stages have counted so far: waits for the stream.
using ReadNumbers = std::function<ReyesNumbers()>;

/// Parts that a piece may be cut into at a time.
constexpr uint32_t most_parts = 4;

/// The pieces of a level: the topmost ones of a stack where `waiting` are, then patches from next_slot on. num_leaves: before it.
struct PiecesOfLevel {
  uint32_t waiting, from_stack, next_slot, from_slots, num_leaves;

#if defined(__CUDACC__)
  __device__ QueuedPiece take(const ReyesBatch &b, bool has_piece, uint32_t i) const
  {
    if (has_piece && i < from_stack) return b.stack[waiting - 1 - i];
    return {whole_patch(), has_piece ? next_slot + (i - from_stack) : 0};
  }
#endif
};

/// Memory of a queue whose places are sums over what pieces wrote, by a technique of compaction.
struct MappedQueue {
  Compaction method = Compaction::Auto;  // Auto: there is no such queue, pieces are pushed
  uint32_t *parts = nullptr, *waits = nullptr, *is_diced = nullptr, *places = nullptr, *leaf_places = nullptr;
  void *memory = nullptr;
  uint64_t memory_bytes = 0;

  /// For levels of a stack.
  static MappedQueue lay_out(Layout &layout, Compaction method, uint32_t stack_capacity);
};

/// Cuts pieces until none wait, or until the list of those that are to be diced is full: level by level; returns how many. What
/// comes of them is pushed, or mapped and unmapped.
uint32_t split_by_levels(const ReyesBatch &batch, const MappedQueue &queue, const ReadNumbers &read,
                         cudaStream_t stream);

/// One level by way of `mapped`, most_parts places for each piece: `pushed` pieces come to the stack, `num_cut_leaves` to the leaves.
void split_mapped_level(const ReyesBatch &batch, const MappedQueue &queue, const PiecesOfLevel &pieces,
                        QueuedPiece *mapped, cudaStream_t stream);

/// The same by blocks that have queues of their own. `turn` counts launches of the batch's memory, from 1 on; `ready`:
/// numbers as many as the stack has places, which were zero before turn 1; `last`: what was counted after the last launch
/// of the batch, null for the first one. False: there is no room for what waits and for what blocks may leave besides; nothing is
/// done.
bool split_by_queues(const ReyesBatch &batch, uint32_t *ready, uint32_t turn, const ReyesNumbers *last,
                     cudaStream_t stream);

/// Makes a stack, as launch_split takes it, of what the launch `turn` of queues left.
void stack_queues(const ReyesBatch &batch, uint32_t turn, const ReyesNumbers &last, cudaStream_t stream);

}  // namespace gpurt::cuda
