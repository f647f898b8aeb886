// Stage 'split': pieces are cut until they can be diced, by threads that wait for each other after every round.
//
// Pieces lie on a stack: a round takes the topmost ones, as many as there are threads, and what it cuts comes back on top.
// So memory is bounded by the depth of cutting, not by the number of pieces: rounds take fewer where the stack fills up,
// and one at a time always ends, since a piece leaves at most three others behind on each of its levels.
// Source: the talk's queue whose output goes back to its input; here with one launch for all rounds.
#include <cooperative_groups.h>

#include "cuda/launch.h"
#include "cuda/reyes/stages.h"

namespace gpurt::cuda {
namespace {

constexpr unsigned split_threads = 256;
// More of them make waiting for each other take longer.
constexpr int most_blocks_per_multiprocessor = 2;
// Lanes that share a piece: few pieces wait at a time on small images, where the time of one decides.
constexpr uint32_t group_lanes = 4;
// Places of the stack that rounds of more than one piece leave free: more than what the deepest piece needs on its way.
constexpr uint32_t stack_reserve = 2 * (3 * (parameter_bits - smallest_piece_bits) + 4);

__device__ uint32_t lane_id() { return threadIdx.x % 32; }

// Adds `each` for every lane that takes part; the first one's place.
__device__ uint32_t take_places(uint32_t *counter, bool takes, uint32_t each)
{
  const uint32_t lanes = __ballot_sync(0xffffffffu, takes);
  uint32_t base = 0;
  if (lane_id() == 0 && lanes != 0) base = atomicAdd(counter, each * uint32_t(__popc(lanes)));
  base = __shfl_sync(0xffffffffu, base, 0);
  return base + each * uint32_t(__popc(lanes & ((1u << lane_id()) - 1)));
}

// The control points of a piece, for the lanes that share it.
struct SharedPart {
  float x[16], y[16], w[16];
  float px[16], py[16];  // on the image
  float pad[4];          // so that lanes of different pieces meet different banks
};

// The largest over the lanes of a group.
__device__ float group_max(float x)
{
  x = max(x, __shfl_xor_sync(0xffffffffu, x, 1));
  return max(x, __shfl_xor_sync(0xffffffffu, x, 2));
}

// As decide_piece, by the lanes of a group together: a lane takes a coordinate, a row, an edge. False: it cannot be seen.
// All lanes of the warp call it; groups with the same piece everywhere.
__device__ bool decide(const ReyesBatch &b, QueuedPiece &q, SharedPart &part, uint32_t lane,
                       PieceAction &action)
{
  const RasterPatch &patch = b.patches[q.slot];
  Piece &p = q.piece;
  if (lane < 3) {
    const float u0 = parameter(p.u), u1 = parameter(p.u + (1u << p.u_bits));
    const float v0 = parameter(p.v), v1 = parameter(p.v + (1u << p.v_bits));
    const float(&from)[16] = lane == 0 ? patch.x : (lane == 1 ? patch.y : patch.w);
    float(&to)[16] = lane == 0 ? part.x : (lane == 1 ? part.y : part.w);
    float sub[16];
    sub_patch(from, u0, u1, v0, v1, sub);
    for (int i = 0; i < 16; ++i) to[i] = sub[i];
  }
  __syncwarp();
  // A row each, and a corner that may have been moved.
  FrustumReach reach{-infinity, -infinity, -infinity, -infinity, -infinity};
  bool is_in_front = true;
  for (uint32_t i = 4 * lane; i < 4 * lane + 4; ++i) {
    reach = max(reach, frustum_reach(part.x[i], part.y[i], part.w[i], b.rect));
    is_in_front &= part.w[i] >= smallest_w;
    const float inv_w = 1.0f / part.w[i];
    part.px[i] = part.x[i] * inv_w;
    part.py[i] = part.y[i] * inv_w;
  }
  const uint32_t u = lane & 1 ? p.u + (1u << p.u_bits) : p.u, v = lane & 2 ? p.v + (1u << p.v_bits) : p.v;
  if (p.corner_u[lane] != u || p.corner_v[lane] != v) {
    const RasterPoint c = patch_point(patch, p.corner_u[lane], p.corner_v[lane]);
    reach = max(reach, frustum_reach(c.x, c.y, c.w, b.rect));
  }
  reach = {group_max(reach.left), group_max(reach.right), group_max(reach.top), group_max(reach.bottom),
           group_max(reach.front)};
  const uint32_t group = threadIdx.x % 32 / group_lanes * group_lanes;
  is_in_front =
      (__ballot_sync(0xffffffffu, is_in_front) >> group & (1u << group_lanes) - 1) == (1u << group_lanes) - 1;
  const bool is_seen = can_be_seen(reach, b.largest[q.slot], b.rect);
  __syncwarp();
  uint32_t edge = p.edge[lane];
  if (is_seen && edge == open_edge) edge = decide_edge_of(patch, p, lane, b.dice);
  for (uint32_t e = 0; e < 4; ++e) p.edge[e] = uint8_t(__shfl_sync(0xffffffffu, edge, int(group + e)));
  float length_u, length_v;
  if (is_in_front) polygon_lengths(part.px, part.py, part.w, 0.0f, int(lane), length_u, length_v);
  else polygon_lengths(part.x, part.y, part.w, b.dice.half_width, int(lane), length_u, length_v);
  length_u = group_max(length_u);
  length_v = group_max(length_v);
  action = choose_action(p, is_in_front, length_u, length_v, b.dice);
  __syncwarp();
  return is_seen;
}

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
  for (uint32_t round = 0;; ++round) {
    const uint32_t room = b.stack_capacity - waiting;
    uint32_t n = min(num_takers, room > stack_reserve + 8 ? (room - stack_reserve) / 8 : 1u);
    n = min(n, b.leaf_capacity - num_leaves);
    const uint32_t from_stack = min(n, waiting), from_slots = min(n - from_stack, num_slots - next_slot);
    n = from_stack + from_slots;
    if (n == 0) break;

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
  }
}

unsigned resident_blocks()
{
  int device = 0, num_multiprocessors = 0, blocks = 0;
  check(cudaGetDevice(&device), "cudaGetDevice");
  check(cudaDeviceGetAttribute(&num_multiprocessors, cudaDevAttrMultiProcessorCount, device),
        "cudaDeviceGetAttribute");
  check(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&blocks, split_pieces, int(split_threads), 0),
        "cudaOccupancyMaxActiveBlocksPerMultiprocessor");
  return unsigned(num_multiprocessors) * unsigned(max(1, min(blocks, most_blocks_per_multiprocessor)));
}

}  // namespace

void launch_split(const ReyesBatch &batch, cudaStream_t stream)
{
  ReyesBatch argument = batch;
  void *arguments[] = {&argument};
  const char *name = "REYES stage 'split'";
  check(cudaLaunchCooperativeKernel(reinterpret_cast<const void *>(split_pieces), dim3(resident_blocks()),
                                    dim3(split_threads), arguments, 0, stream),
        name);
  note_launch(name, reinterpret_cast<const void *>(split_pieces), split_threads);
}

}  // namespace gpurt::cuda
