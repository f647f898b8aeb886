// Stage 'split' by persistent blocks: each has a queue of its own in shared memory, cuts from its top and puts the parts back;
// what it has too much of while others have nothing it donates to a queue of all.
//
// The queue of all is filled once from its beginning in a launch: a place belongs to one piece, and a number beside it says
// that the piece is there. A block that finds nothing waits until some piece is donated or none is left anywhere. When the
// list of what is to be diced is full, blocks leave their pieces behind the queue's end for the next launch; where that could find
// no room for what its blocks would leave, the batch goes on in rounds (split.cu), whose memory is bounded.
// Source: Tzeng, Patney and Owens 2010, task donation; the talk's persistent threads with work stealing.
#include "cuda/reyes/decide.h"
#include "cuda/reyes/split_schedules.h"

namespace gpurt::cuda {
namespace {

constexpr uint32_t block_takers = split_threads / group_lanes;
// Pieces of a block's queue. Enough for the parts of as many as the block cuts at a time, and of the deepest one.
constexpr uint32_t local_capacity = 4 * block_takers + 2 * deepest_stack;
// What a block keeps when it donates.
constexpr uint32_t kept_pieces = 16;
constexpr int most_blocks_per_multiprocessor = 2;

// A queue in device memory for one launch.
struct SharedQueue {
  QueuedPiece *pieces;
  uint32_t *ready;  // `turn` where the piece is there
  uint32_t turn;
  uint32_t limit;  // places that pieces are taken from; behind them is what blocks leave for the next launch
  uint32_t most_given;  // places for donations
  uint32_t num_first;   // pieces that were there before the launch
};

// Past caches: other blocks wrote it.
__device__ void read_piece(QueuedPiece &to, const QueuedPiece &from)
{
  for (uint32_t i = 0; i < sizeof(QueuedPiece) / 4; ++i)
    reinterpret_cast<uint32_t *>(&to)[i] = __ldcg(reinterpret_cast<const uint32_t *>(&from) + i);
}

__device__ uint32_t load(const uint32_t *p) { return *const_cast<const volatile uint32_t *>(p); }

// Takes up to `want` pieces that were donated, or fresh patches: called by one thread. Returns how many; 0: there are none
// now. `at`: the first one's place, or the first patch.
__device__ uint32_t take_work(const ReyesBatch &b, const SharedQueue &queue, uint32_t &at, bool &is_fresh)
{
  ReyesNumbers &n = *b.numbers;
  for (uint32_t head = load(&n.queue_head);;) {
    const uint32_t tail = min(load(&n.queue_tail), queue.limit);
    if (head >= tail) break;
    // Shared among those who wait.
    const uint32_t want = min(block_takers, max((tail - head) / max(load(&n.idle_blocks), 1u), 1u));
    const uint32_t seen = atomicCAS(&n.queue_head, head, head + want);
    if (seen == head) {
      at = head;
      is_fresh = false;
      return want;
    }
    head = seen;
  }
  const uint32_t num_slots = n.num_slots, next = load(&n.next_slot);
  if (next >= num_slots) return 0;
  const uint32_t want = min(block_takers, max((num_slots - next) / gridDim.x, 1u));
  // Counted before they are taken, so that nobody thinks that all is done.
  atomicAdd(&n.live_pieces, want);
  at = atomicAdd(&n.next_slot, want);
  const uint32_t got = at < num_slots ? min(want, num_slots - at) : 0;
  if (got != want) atomicSub(&n.live_pieces, want - got);
  is_fresh = true;
  return got;
}

__global__ void __launch_bounds__(split_threads)
    split_with_queues(const __grid_constant__ ReyesBatch b, const __grid_constant__ SharedQueue queue)
{
  __shared__ SharedPart parts[block_takers];
  __shared__ QueuedPiece local[local_capacity];
  __shared__ uint32_t pushed, taken, taken_at, num_given, given_at;
  __shared__ bool is_fresh;
  ReyesNumbers &numbers = *b.numbers;
  const uint32_t lane = threadIdx.x % group_lanes, taker = threadIdx.x / group_lanes;
  // The queue is local[base ..], a ring; every thread keeps the same account.
  uint32_t base = 0, waiting = 0, num_rounds = 0, num_splits = 0, num_culled = 0, num_donated = 0,
           largest = 0;
  const auto place = [&](uint32_t i) { return (base + i) % local_capacity; };
  for (;;) {
    if (waiting == 0) {
      if (threadIdx.x == 0) {
        bool is_idle = false;
        for (;;) {
          taken = load(&numbers.stops) != 0 ? 0 : take_work(b, queue, taken_at, is_fresh);
          if (taken != 0 || load(&numbers.stops) != 0) break;
          if (load(&numbers.live_pieces) == 0 && load(&numbers.next_slot) >= numbers.num_slots) break;
          if (!is_idle) atomicAdd(&numbers.idle_blocks, 1u);
          is_idle = true;
          __nanosleep(64);
        }
        if (is_idle) atomicSub(&numbers.idle_blocks, 1u);
      }
      __syncthreads();
      if (taken == 0) break;
      waiting = taken;
      if (threadIdx.x < waiting) {
        const uint32_t at = taken_at + threadIdx.x;
        if (is_fresh) local[place(threadIdx.x)] = {whole_patch(), at};
        else {
          // Its donor is about to write it.
          while (at >= queue.num_first && load(queue.ready + at) != queue.turn) {
          }
          __threadfence();
          read_piece(local[place(threadIdx.x)], queue.pieces[at]);
        }
      }
      __syncthreads();
    }
    ++num_rounds;
    const uint32_t room = local_capacity - waiting;
    const uint32_t n =
        min(min(block_takers, waiting), room > deepest_stack + 3 ? (room - deepest_stack) / 3 : 1u);
    if (threadIdx.x == 0) pushed = 0;
    QueuedPiece q{whole_patch(), 0};
    const bool has_piece = taker < n;
    if (has_piece) q = local[place(waiting - 1 - taker)];
    PieceAction action = PieceAction::Cull;
    bool is_seen = false;
    if (__any_sync(0xffffffffu, has_piece)) is_seen = decide(b, q, parts[taker], lane, action);
    const bool decides = has_piece && lane == 0;
    bool is_diced = decides && is_seen && action == PieceAction::Dice;
    const bool is_split = decides && is_seen && action != PieceAction::Dice;
    const uint32_t leaf = take_places(&numbers.num_leaves, is_diced, 1);
    uint32_t num_parts = 0;
    Piece pieces[4];
    if (is_split) {
      num_parts = split_piece(q.piece, action, pieces);
      num_splits += num_parts - 1;
    } else if (is_diced && leaf >= b.leaf_capacity) {
      // No room: it waits for the next launch.
      pieces[0] = q.piece;
      num_parts = 1;
      is_diced = false;
      atomicExch(&numbers.stops, 1u);
    }
    if (is_diced) b.leaves[leaf] = q;
    num_culled += decides && !is_seen ? 1 : 0;
    // All pieces of the round are in registers.
    __syncthreads();
    if (num_parts != 0) {
      const uint32_t at = waiting - n + atomicAdd(&pushed, num_parts);
      for (uint32_t i = 0; i < num_parts; ++i) local[place(at + i)] = {pieces[i], q.slot};
    }
    __syncthreads();
    waiting = waiting - n + pushed;
    largest = max(largest, waiting);
    const bool stops = load(&numbers.stops) != 0;
    if (threadIdx.x == 0) {
      if (pushed > n) atomicAdd(&numbers.live_pieces, pushed - n);
      else atomicSub(&numbers.live_pieces, n - pushed);
      num_given = 0;
      given_at = 0;
      taken = stops ? 1 : 0;
      if (stops) {
        num_given = waiting;
        given_at = queue.limit + atomicAdd(&numbers.num_left, waiting);
      } else if (waiting > 2 * kept_pieces && load(&numbers.idle_blocks) != 0 &&
                 load(&numbers.queue_tail) < queue.most_given) {
        num_given = waiting - kept_pieces;
        given_at = atomicAdd(&numbers.queue_tail, num_given);
        num_given = given_at < queue.limit ? min(num_given, queue.limit - given_at) : 0;
        num_donated += num_given;
      }
    }
    __syncthreads();
    // The lowest ones, which are the largest.
    for (uint32_t i = threadIdx.x; i < num_given; i += split_threads) {
      queue.pieces[given_at + i] = local[place(i)];
      __threadfence();
      if (taken == 0) *const_cast<volatile uint32_t *>(queue.ready + given_at + i) = queue.turn;
    }
    const uint32_t given = num_given;
    const bool ends = taken != 0;
    __syncthreads();
    base = place(given);
    waiting -= given;
    if (ends) break;
  }
  for (int offset = 16; offset != 0; offset /= 2) {
    num_splits += __shfl_down_sync(0xffffffffu, num_splits, offset);
    num_culled += __shfl_down_sync(0xffffffffu, num_culled, offset);
  }
  if (lane_id() == 0 && num_splits != 0) atomicAdd(&numbers.num_splits, (unsigned long long)num_splits);
  if (lane_id() == 0 && num_culled != 0) atomicAdd(&numbers.num_culled, (unsigned long long)num_culled);
  if (threadIdx.x != 0) return;
  if (num_donated != 0) atomicAdd(&numbers.num_donated, (unsigned long long)num_donated);
  atomicMax(&numbers.split_rounds, (unsigned long long)num_rounds);
  atomicMax(&numbers.largest_queue, largest);
}

__global__ void begin_queues(ReyesNumbers *n, uint32_t num_first)
{
  n->queue_head = 0;
  n->queue_tail = num_first;
  n->idle_blocks = 0;
  n->num_left = 0;
}

// What is left becomes what waits; what was taken beyond the lists' ends is taken back.
__global__ void note_queues(ReyesBatch b, uint32_t limit)
{
  ReyesNumbers &n = *b.numbers;
  n.queue_tail = min(n.queue_tail, limit);
  n.left_at = limit;
  n.waiting = n.queue_tail - n.queue_head + n.num_left;
  n.next_slot = min(n.next_slot, n.num_slots);
  n.num_leaves = min(n.num_leaves, b.leaf_capacity);
  n.live_pieces = n.waiting;
  n.stops = 0;
}

}  // namespace

void stack_queues(const ReyesBatch &batch, uint32_t turn, const ReyesNumbers &last, cudaStream_t stream)
{
  const uint32_t half = batch.stack_capacity / 2, num_queued = last.queue_tail - last.queue_head;
  QueuedPiece *const old = batch.stack + (turn % 2) * half, *const other =
                                                                batch.stack + (turn + 1) % 2 * half;
  const auto copy = [&](QueuedPiece *to, const QueuedPiece *from, uint32_t n) {
    check(cudaMemcpyAsync(to, from, n * sizeof(QueuedPiece), cudaMemcpyDeviceToDevice, stream),
          "cudaMemcpyAsync");
  };
  // What blocks had in hand on top: it is deepest. By way of the other half, for places overlap.
  copy(other, old + last.queue_head, num_queued);
  copy(other + num_queued, old + last.left_at, last.num_left);
  if (other != batch.stack) copy(batch.stack, other, num_queued + last.num_left);
}

bool split_by_queues(const ReyesBatch &batch, uint32_t *ready, uint32_t turn, const ReyesNumbers *last,
                     cudaStream_t stream)
{
  // Halves of the stack's memory take turns: what one launch left is copied to the beginning of the other.
  const uint32_t half = batch.stack_capacity / 2;
  const unsigned blocks = max(min(resident_split_blocks(reinterpret_cast<const void *>(split_with_queues),
                                                        most_blocks_per_multiprocessor),
                                  half / 3 / local_capacity),
                              1u);
  const uint32_t room = blocks * local_capacity, most_given = half > 2 * room ? half - 2 * room : 0;
  QueuedPiece *pieces = batch.stack + (turn % 2) * half;
  uint32_t num_first = 0;
  if (last != nullptr && last->waiting != 0) {
    const QueuedPiece *old = batch.stack + ((turn + 1) % 2) * half;
    if (last->waiting + room > half) return false;
    const auto copy = [&](const QueuedPiece *from, uint32_t n) {
      check(cudaMemcpyAsync(pieces + num_first, from, n * sizeof(QueuedPiece), cudaMemcpyDeviceToDevice,
                            stream),
            "cudaMemcpyAsync");
      num_first += n;
    };
    // What blocks had in hand first: it is deepest.
    copy(old + last->left_at, last->num_left);
    copy(old + last->queue_head, last->queue_tail - last->queue_head);
  }
  const uint32_t limit = max(most_given, num_first);
  launch_blocks("REYES' queue of pieces", begin_queues, 1, 1, stream, batch.numbers, num_first);
  const SharedQueue queue{pieces, ready + (turn % 2) * half, turn, limit, most_given, num_first};
  launch_blocks("REYES stage 'split', queues of blocks", split_with_queues, blocks, split_threads, stream,
                batch, queue);
  launch_blocks("REYES' account of queues", note_queues, 1, 1, stream, batch, limit);
  return true;
}

}  // namespace gpurt::cuda
