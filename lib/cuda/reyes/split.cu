// Stage 'split': pieces are cut until they can be diced, by threads that wait for each other after every round.
//
// Pieces lie on two stacks: a round takes the topmost ones of one, as many as there are takers, and what it cuts goes onto the
// other, so that nobody writes where others still read and blocks meet once a round. Where few pieces wait, a block goes on
// with the parts of its own by itself: on small images the time of one piece after the other decides.
// So memory is bounded by the depth of cutting, not by the number of pieces: rounds take fewer where a stack fills up. Where
// both are full, one piece is taken at a time and its parts go where it was; that always ends, since a piece leaves at most
// three others behind on each of its levels.
// Source: the talk's queue whose output goes back to its input; here with one launch for all rounds.
#include <cooperative_groups.h>

#include "cuda/reyes/decide.h"

namespace gpurt::cuda {
namespace {

// More of them make waiting for each other take longer, and leave no room for the kernel that finds samples' places meanwhile.
constexpr int most_blocks_per_multiprocessor = 1;
// Groups of lanes that take a piece each.
constexpr uint32_t block_takers = split_threads / group_lanes;
// Turns of a block in a round: the first one takes pieces of a stack, further ones its own parts.
constexpr uint32_t most_turns = 3;
// Places that rounds of more than one piece leave free of a stack: more than what the deepest piece needs on its way.
constexpr uint32_t stack_reserve = 2 * deepest_stack;

// Every thread keeps the same one.
struct SplitAccount {
  uint32_t low, high;  // pieces that wait on the two stacks
  uint32_t next_slot, num_leaves;

  __device__ uint32_t waiting(uint32_t stack) const { return stack == 0 ? low : high; }
  __device__ void add(uint32_t stack, uint32_t n)
  {
    low += stack == 0 ? n : 0;
    high += stack == 0 ? 0 : n;
  }
};

struct SplitRound {
  uint32_t from_stack, from_slots;  // pieces that are taken
  uint32_t from, to;                // stacks
  bool is_roomy;                    // for all that blocks can make in their turns

  __device__ uint32_t num() const { return from_stack + from_slots; }
};

// `last`: the stack that parts went to.
__device__ SplitRound plan_round(const ReyesBatch &b, const SplitAccount &a, uint32_t num_slots,
                                 uint32_t last)
{
  const uint32_t capacity = b.stack_capacity / 2, num_takers = gridDim.x * block_takers;
  SplitRound r;
  r.from = last;
  if (a.waiting(r.from) < num_takers && a.waiting(1 - r.from) > a.waiting(r.from)) r.from = 1 - r.from;
  if (capacity - a.waiting(1 - r.from) < stack_reserve + 4) r.from = 1 - r.from;
  const uint32_t room = capacity - a.waiting(1 - r.from);
  const bool is_full = room < stack_reserve + 4;
  r.to = is_full ? r.from : 1 - r.from;
  const uint32_t part_room = is_full ? 4 : room - stack_reserve, leaf_room = b.leaf_capacity - a.num_leaves;
  const uint32_t n = min(min(num_takers, part_room / 4), leaf_room);
  r.from_stack = min(n, a.waiting(r.from));
  r.from_slots = min(n - r.from_stack, num_slots - a.next_slot);
  // Of the blocks that have a piece.
  const uint32_t most_takers = min(r.num(), gridDim.x) * block_takers;
  r.is_roomy = part_room >= 4 * most_takers && leaf_room >= most_turns * most_takers;
  return r;
}

// Part k of those that a piece is cut into.
__device__ Piece part_of(const Piece &p, PieceAction action, uint32_t k)
{
  Piece low, high;
  if (action == PieceAction::SplitV) {
    split_v(p, low, high);
    return (k & 1) == 0 ? low : high;
  }
  split_u(p, low, high);
  const Piece half = (k & 1) == 0 ? low : high;
  if (action == PieceAction::SplitU) return half;
  split_v(half, low, high);
  return (k & 2) == 0 ? low : high;
}

// Parts, and pieces that are to be diced.
struct SplitCounts {
  uint32_t parts, leaves;
};
// Both in a number: a block has 256 and 64 at the most.
__device__ uint32_t packed(SplitCounts c) { return c.leaves << 16 | c.parts; }
__device__ SplitCounts unpacked(uint32_t c) { return {c & 0xffff, c >> 16}; }

__global__ void __launch_bounds__(split_threads, 2) split_pieces(const __grid_constant__ ReyesBatch b)
{
  const auto grid = cooperative_groups::this_grid();
  ReyesNumbers &numbers = *b.numbers;
  __shared__ SharedPart shared_parts[block_takers];
  __shared__ QueuedPiece own[block_takers];
  __shared__ uint32_t counted;
  __shared__ unsigned long long shared_base;
  const uint32_t lane = threadIdx.x % group_lanes, group = lane_id() / group_lanes;
  // A round's pieces are spread over blocks first, then over their warps.
  const uint32_t taker = group * (split_threads / 32) + threadIdx.x / 32;
  const uint32_t num_slots = numbers.num_slots, capacity = b.stack_capacity / 2;
  SplitAccount a{numbers.waiting - numbers.waiting_high, numbers.waiting_high, numbers.next_slot,
                 numbers.num_leaves};
  uint32_t num_splits = 0, num_culled = 0, largest = numbers.waiting, num_rounds = 0, last = 0;
  for (uint32_t turn_of_sums = 0;; turn_of_sums = (turn_of_sums + 1) % 3) {
    const SplitRound r = plan_round(b, a, num_slots, last);
    if (r.num() == 0) break;
    ++num_rounds;
    // Sums of parts and, 2^32 each, of leaves. The next round's were read two meetings ago.
    unsigned long long &sums = numbers.rounds[turn_of_sums];
    if (blockIdx.x == 0 && threadIdx.x == 0) numbers.rounds[(turn_of_sums + 1) % 3] = 0;
    const uint32_t rest = a.waiting(r.from) - r.from_stack;
    QueuedPiece *to = b.stack + r.to * capacity + (r.to == r.from ? rest : a.waiting(r.to));
    const uint32_t number = blockIdx.x + taker * gridDim.x;
    bool has_piece = number < r.num();
    QueuedPiece q{whole_patch(), 0};
    if (has_piece) {
      if (number < r.from_stack) q = b.stack[r.from * capacity + rest + number];
      else q.slot = a.next_slot + (number - r.from_stack);
    }
    for (uint32_t turn = 1;; ++turn) {
      if (threadIdx.x == 0) counted = 0;
      __syncthreads();
      PieceAction action = PieceAction::Cull;
      bool is_seen = false;
      if (__any_sync(0xffffffffu, has_piece))
        is_seen = decide(b, q, shared_parts[threadIdx.x / group_lanes], lane, action) && has_piece;
      const bool is_diced = is_seen && action == PieceAction::Dice, is_cut = is_seen && !is_diced;
      const uint32_t num_parts = is_cut ? (action == PieceAction::SplitBoth ? 4 : 2) : 0;
      if (lane == 0) {
        num_splits += is_cut ? num_parts - 1 : 0;
        num_culled += has_piece && !is_seen ? 1 : 0;
      }
      // Groups add up in their warp, warps in their block, blocks together.
      const uint32_t mine = packed({num_parts, is_diced ? 1u : 0u});
      uint32_t up_to = mine;
      for (uint32_t offset = group_lanes; offset < 32; offset *= 2) {
        const uint32_t other = __shfl_up_sync(0xffffffffu, up_to, offset);
        if (lane_id() >= offset) up_to += other;
      }
      uint32_t warp_base = 0;
      if (lane_id() == 31 && up_to != 0) warp_base = atomicAdd(&counted, up_to);
      const SplitCounts at = unpacked(__shfl_sync(0xffffffffu, warp_base, 31) + (up_to - mine));
      __syncthreads();
      const SplitCounts made = unpacked(counted);
      const bool goes_on = r.is_roomy && turn < most_turns && made.parts != 0 && made.parts <= block_takers;
      if (threadIdx.x == 0 && made.parts + made.leaves != 0) {
        shared_base = atomicAdd(
            &sums, static_cast<unsigned long long>(made.leaves) << 32 | (goes_on ? 0u : made.parts));
      }
      __syncthreads();
      const unsigned long long base = shared_base;
      if (is_diced && lane == 0) b.leaves[a.num_leaves + uint32_t(base >> 32) + at.leaves] = q;
      if (lane < num_parts)
        (goes_on ? own : to + uint32_t(base))[at.parts + lane] = {part_of(q.piece, action, lane), q.slot};
      if (!goes_on) break;
      __syncthreads();
      has_piece = taker < made.parts;
      if (has_piece) q = own[taker];
    }
    // All pieces are taken, and what they were cut into is there.
    grid.sync();
    const unsigned long long sum = *const_cast<volatile unsigned long long *>(&sums);
    a.add(r.from, 0 - r.from_stack);
    a.add(r.to, uint32_t(sum));
    a.next_slot += r.from_slots;
    a.num_leaves += uint32_t(sum >> 32);
    last = r.to;
    largest = max(largest, a.low + a.high + (num_slots - a.next_slot));
  }
  for (int offset = 16; offset != 0; offset /= 2) {
    num_splits += __shfl_down_sync(0xffffffffu, num_splits, offset);
    num_culled += __shfl_down_sync(0xffffffffu, num_culled, offset);
  }
  if (lane_id() == 0 && num_splits != 0) atomicAdd(&numbers.num_splits, (unsigned long long)num_splits);
  if (lane_id() == 0 && num_culled != 0) atomicAdd(&numbers.num_culled, (unsigned long long)num_culled);
  // Nobody reads these any more: all have begun, or what is written is what was there.
  if (blockIdx.x == 0 && threadIdx.x == 0) {
    numbers.waiting = a.low + a.high;
    numbers.waiting_high = a.high;
    numbers.next_slot = a.next_slot;
    numbers.num_leaves = a.num_leaves;
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

unsigned split_blocks()
{
  return resident_split_blocks(reinterpret_cast<const void *>(split_pieces), most_blocks_per_multiprocessor);
}

void launch_split(const ReyesBatch &batch, unsigned num_blocks, cudaStream_t stream)
{
  ReyesBatch argument = batch;
  void *arguments[] = {&argument};
  const char *name = "REYES stage 'split'";
  check(cudaLaunchCooperativeKernel(reinterpret_cast<const void *>(split_pieces), dim3(num_blocks),
                                    dim3(split_threads), arguments, 0, stream),
        name);
  note_launch(name, reinterpret_cast<const void *>(split_pieces), split_threads);
}

}  // namespace gpurt::cuda
