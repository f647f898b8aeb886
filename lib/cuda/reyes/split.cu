// Stage 'split': pieces are cut until they can be diced, by threads that wait for each other after every round.
//
// Pieces lie on a stack: a round takes the topmost ones, as many as there are threads, and what it cuts comes back on top.
// So memory is bounded by the depth of cutting, not by the number of pieces: rounds take fewer where the stack fills up,
// and one at a time always ends, since a piece leaves at most three others behind on each of its levels.
// Source: the talk's queue whose output goes back to its input; here with one launch for all rounds.
#include <cooperative_groups.h>

#include "cuda/reyes/decide.h"

namespace gpurt::cuda {
namespace {

// More of them make waiting for each other take longer.
constexpr int most_blocks_per_multiprocessor = 2;
// Places of the stack that rounds of more than one piece leave free: more than what the deepest piece needs on its way.
constexpr uint32_t stack_reserve = 2 * deepest_stack;

__global__ void __launch_bounds__(split_threads) split_pieces(const __grid_constant__ ReyesBatch b)
{
  const auto grid = cooperative_groups::this_grid();
  ReyesNumbers &numbers = *b.numbers;
  __shared__ SharedPart parts[split_threads / group_lanes];
  const uint32_t thread = blockIdx.x * split_threads + threadIdx.x, lane = thread % group_lanes;
  const uint32_t taker = thread / group_lanes, num_takers = gridDim.x * split_threads / group_lanes;
  // Every thread keeps the same account.
  uint32_t waiting = numbers.waiting, next_slot = numbers.next_slot, num_leaves = numbers.num_leaves;
  const uint32_t num_slots = numbers.num_slots;
  uint32_t num_splits = 0, num_culled = 0, largest = waiting;
  uint32_t num_rounds = 0;
  for (uint32_t round = 0;; ++round) {
    const uint32_t room = b.stack_capacity - waiting;
    uint32_t n = min(num_takers, room > stack_reserve + 8 ? (room - stack_reserve) / 8 : 1u);
    n = min(n, b.leaf_capacity - num_leaves);
    const uint32_t from_stack = min(n, waiting), from_slots = min(n - from_stack, num_slots - next_slot);
    n = from_stack + from_slots;
    if (n == 0) break;
    ++num_rounds;

    bool is_split = false, is_diced = false;
    const bool has_piece = taker < n;
    QueuedPiece q{whole_patch(), 0};
    PieceAction action = PieceAction::Cull;
    if (__any_sync(0xffffffffu, has_piece)) {
      if (has_piece) {
        if (taker < from_stack) q = b.stack[waiting - 1 - taker];
        else q.slot = next_slot + (taker - from_stack);
      }
      const bool is_seen = decide(b, q, parts[threadIdx.x / group_lanes], lane, action);
      if (has_piece && lane == 0) {
        is_diced = is_seen && action == PieceAction::Dice;
        is_split = is_seen && !is_diced;
        num_culled += is_seen ? 0 : 1;
      }
    }
    const bool is_both = is_split && action == PieceAction::SplitBoth;
    const uint32_t at = take_places(&numbers.pushed[round % 3], is_split, 2);
    const uint32_t more_at = take_places(&numbers.pushed[round % 3], is_both, 2);
    const uint32_t leaf = take_places(&numbers.num_leaves, is_diced, 1);
    if (is_diced) b.leaves[leaf] = q;
    if (thread == 0) numbers.pushed[(round + 1) % 3] = 0;
    // All pieces are taken, and counted.
    grid.sync();
    waiting -= from_stack;
    next_slot += from_slots;
    if (is_split) {
      Piece parts[4];
      const uint32_t num_parts = split_piece(q.piece, action, parts);
      for (uint32_t i = 0; i < num_parts; ++i)
        b.stack[waiting + (i < 2 ? at + i : more_at + i - 2)] = {parts[i], q.slot};
      num_splits += num_parts - 1;
    }
    waiting += *const_cast<volatile uint32_t *>(&numbers.pushed[round % 3]);
    num_leaves = *const_cast<volatile uint32_t *>(&numbers.num_leaves);
    largest = max(largest, waiting + (num_slots - next_slot));
    grid.sync();
  }
  for (int offset = 16; offset != 0; offset /= 2) {
    num_splits += __shfl_down_sync(0xffffffffu, num_splits, offset);
    num_culled += __shfl_down_sync(0xffffffffu, num_culled, offset);
  }
  if (lane_id() == 0 && num_splits != 0) atomicAdd(&numbers.num_splits, (unsigned long long)num_splits);
  if (lane_id() == 0 && num_culled != 0) atomicAdd(&numbers.num_culled, (unsigned long long)num_culled);
  // Nobody reads these any more: the last round ended for all.
  if (thread == 0) {
    numbers.waiting = waiting;
    numbers.next_slot = next_slot;
    for (uint32_t &pushed : numbers.pushed) pushed = 0;
    numbers.largest_queue = max(numbers.largest_queue, largest);
    numbers.split_rounds += num_rounds;
  }
}

}  // namespace

unsigned resident_split_blocks(const void *kernel, int most)
{
  int device = 0, num_multiprocessors = 0, blocks = 0;
  check(cudaGetDevice(&device), "cudaGetDevice");
  check(cudaDeviceGetAttribute(&num_multiprocessors, cudaDevAttrMultiProcessorCount, device),
        "cudaDeviceGetAttribute");
  check(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&blocks, kernel, int(split_threads), 0),
        "cudaOccupancyMaxActiveBlocksPerMultiprocessor");
  return unsigned(num_multiprocessors) * unsigned(max(1, min(blocks, most)));
}

void launch_split(const ReyesBatch &batch, cudaStream_t stream)
{
  ReyesBatch argument = batch;
  void *arguments[] = {&argument};
  const char *name = "REYES stage 'split'";
  check(cudaLaunchCooperativeKernel(reinterpret_cast<const void *>(split_pieces),
                                    dim3(resident_split_blocks(reinterpret_cast<const void *>(split_pieces),
                                                               most_blocks_per_multiprocessor)),
                                    dim3(split_threads), arguments, 0, stream),
        name);
  note_launch(name, reinterpret_cast<const void *>(split_pieces), split_threads);
}

}  // namespace gpurt::cuda
