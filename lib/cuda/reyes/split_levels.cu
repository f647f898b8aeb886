// Stage 'split' with a launch for every level and the host in between, as in the talk's "regular threads with CPU
// readbacks": a level is as many pieces as lists have room for, and the host reads how many have come of them.
#include "cuda/reyes/decide.h"
#include "cuda/reyes/split_schedules.h"

namespace gpurt::cuda {
namespace {

// Pieces of the lower half of the list that the host leaves free, so that the deepest one always ends.
constexpr uint32_t level_reserve = 2 * deepest_stack;

// Cuts the pieces of a level; what comes of them goes to `cut`. Places are taken by a warp's additions: the talk's Push.
__global__ void __launch_bounds__(split_threads)
    split_level(const __grid_constant__ ReyesBatch b, const __grid_constant__ PiecesOfLevel level,
                QueuedPiece *cut)
{
  __shared__ SharedPart parts[split_threads / group_lanes];
  const uint32_t thread = blockIdx.x * split_threads + threadIdx.x, lane = thread % group_lanes,
                 taker = thread / group_lanes;
  const bool has_piece = taker < level.from_stack + level.from_slots;
  QueuedPiece q = level.take(b, has_piece, taker);
  PieceAction action;
  const bool is_seen = decide(b, q, parts[threadIdx.x / group_lanes], lane, action);
  const bool decides = has_piece && lane == 0;
  const bool is_diced = decides && is_seen && action == PieceAction::Dice,
             is_split = decides && is_seen && !is_diced;
  const bool is_both = is_split && action == PieceAction::SplitBoth;
  ReyesNumbers &numbers = *b.numbers;
  const uint32_t at = take_places(&numbers.pushed, is_split, 2);
  const uint32_t more_at = take_places(&numbers.pushed, is_both, 2);
  const uint32_t leaf = take_places(&numbers.num_leaves, is_diced, 1);
  if (is_diced) b.leaves[leaf] = q;
  if (is_split) {
    Piece pieces[most_parts];
    const uint32_t n = split_piece(q.piece, action, pieces);
    for (uint32_t i = 0; i < n; ++i) cut[i < 2 ? at + i : more_at + i - 2] = {pieces[i], q.slot};
  }
  count_level(numbers, decides && !is_seen, is_split, is_both);
}

__global__ void note_levels(ReyesNumbers *numbers, uint32_t waiting, uint32_t next_slot, uint32_t largest,
                            uint32_t num_levels)
{
  numbers->waiting = waiting;
  numbers->next_slot = next_slot;
  numbers->largest_queue = max(numbers->largest_queue, largest);
  numbers->split_rounds += num_levels;
}

}  // namespace

uint32_t split_by_levels(const ReyesBatch &batch, const MappedQueue &queue, const ReadNumbers &read,
                         cudaStream_t stream)
{
  ReyesNumbers numbers = read();
  const uint32_t half = batch.stack_capacity / 2;
  QueuedPiece *cut = batch.stack + half;
  uint32_t waiting = numbers.waiting, next_slot = numbers.next_slot, largest = 0, num_levels = 0;
  for (;; ++num_levels) {
    largest = max(largest, waiting + (numbers.num_slots - next_slot));
    uint32_t n = waiting + level_reserve < half ? (half - level_reserve - waiting) / 4 : 0;
    n = max(min(n, half / 4), 1u);
    n = min(n, batch.leaf_capacity - numbers.num_leaves);
    const uint32_t from_stack = min(n, waiting),
                   from_slots = min(n - from_stack, numbers.num_slots - next_slot);
    n = from_stack + from_slots;
    if (n == 0) break;
    const PiecesOfLevel level{waiting, from_stack, next_slot, from_slots, numbers.num_leaves};
    const bool is_pushed = queue.method == Compaction::Auto;
    if (is_pushed) {
      check(cudaMemsetAsync(&batch.numbers->pushed, 0, sizeof(uint32_t), stream), "cudaMemsetAsync");
      launch_blocks("REYES stage 'split', a level", split_level,
                    (n * group_lanes + split_threads - 1) / split_threads, split_threads, stream, batch,
                    level, cut);
    } else {
      split_mapped_level(batch, queue, level, cut, stream);
    }
    numbers = read();
    waiting -= from_stack;
    next_slot += from_slots;
    const uint32_t num_cut = numbers.pushed;
    if (is_pushed) {
      check(cudaMemcpyAsync(batch.stack + waiting, cut, num_cut * sizeof(QueuedPiece),
                            cudaMemcpyDeviceToDevice, stream),
            "cudaMemcpyAsync");
    }
    waiting += num_cut;
  }
  launch_blocks("REYES' account of levels", note_levels, 1, 1, stream, batch.numbers, waiting, next_slot,
                largest, num_levels);
  return num_levels;
}

}  // namespace gpurt::cuda
