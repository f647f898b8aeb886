// Stages 'dice', 'shade' and 'sample' in one kernel whose warps turn to the stage that has most waiting: the talk's
// uber-kernel, in the shared memory of its blocks.
//
// A block has room for a few grids. A warp looks for work from the end of the pipeline: grids that are shaded are sampled
// once enough of them wait, grids that are diced are shaded likewise, else there is room to dice the next one. So what is
// between the stages stays bounded, and nothing goes through device memory or the host.
#include "cuda/reyes/sample_quads.h"

namespace gpurt::cuda {
namespace {

constexpr uint32_t num_warps = block_size / 32;
// More than there are warps: some wait while all work.
constexpr uint32_t num_rooms = 6;
// So many that wait are a full queue.
constexpr uint32_t full_queue = 2;

enum RoomState : uint32_t { is_free = 0, is_busy = 1, is_diced = 2, is_shaded = 3 };

struct Room {
  WarpGrid grid;
  uint32_t packed[max_segments * max_segments];
  uint32_t leaf, root, in_front;
};

// A room in this state becomes the caller's; num_rooms: there is none. By one lane.
__device__ uint32_t take_room(uint32_t *states, uint32_t from)
{
  for (uint32_t i = 0; i < num_rooms; ++i) {
    if (atomicCAS(states + i, from, uint32_t(is_busy)) == from) return i;
  }
  return num_rooms;
}

__device__ uint32_t count_rooms(const uint32_t *states, uint32_t state)
{
  uint32_t n = 0;
  for (uint32_t i = 0; i < num_rooms; ++i)
    n += *const_cast<const volatile uint32_t *>(states + i) == state ? 1 : 0;
  return n;
}

template <class Walk>
__global__ void __launch_bounds__(block_size, 4) dice_shade_sample(const __grid_constant__ ReyesBatch b)
{
  __shared__ Room rooms[num_rooms];
  __shared__ WarpLight lights[num_warps];
  __shared__ uint32_t states[num_rooms];
  const uint32_t lane = threadIdx.x % 32, num_leaves = b.numbers->num_leaves;
  WarpLight &light = lights[threadIdx.x / 32];
  if (threadIdx.x < num_rooms) states[threadIdx.x] = is_free;
  __syncthreads();
  GridCounts counts;
  uint32_t num_switches = 0, last_work = is_free;
  bool has_leaves = true;
  for (;;) {
    // The kind of work is the state of the room that it starts from.
    uint32_t work = is_busy, room = num_rooms;
    if (lane == 0) {
      if (count_rooms(states, is_shaded) >= full_queue && (room = take_room(states, is_shaded)) != num_rooms)
        work = is_shaded;
      else if (count_rooms(states, is_diced) >= full_queue &&
               (room = take_room(states, is_diced)) != num_rooms)
        work = is_diced;
      else if (has_leaves && (room = take_room(states, is_free)) != num_rooms) work = is_free;
      else if ((room = take_room(states, is_shaded)) != num_rooms) work = is_shaded;
      else if ((room = take_room(states, is_diced)) != num_rooms) work = is_diced;
    }
    work = __shfl_sync(all_lanes, work, 0);
    room = __shfl_sync(all_lanes, room, 0);
    if (work == is_busy) {
      // What other warps have in hand they finish themselves.
      if (!has_leaves) break;
      __nanosleep(32);
      continue;
    }
    // What another warp wrote before it handed the room over is there for lane 0 after its fence, and then for all lanes.
    __threadfence_block();
    __syncwarp();
    Room &r = rooms[room];
    uint32_t next = is_free;
    if (work == is_free) {
      const uint32_t leaf = next_item(&b.numbers->tickets[0], num_leaves);
      if (leaf == num_leaves) has_leaves = false;
      else {
        const uint32_t slot = b.leaves[leaf].slot;
        copy_words(r.grid.piece, b.leaves[leaf].piece, lane);
        copy_words(r.grid.patch, b.patches[slot], lane);
        __syncwarp();
        const bool in_front = dice(r.grid, b.projection, lane);
        if (lane == 0) {
          r.leaf = leaf;
          r.root = b.roots[slot];
          r.in_front = in_front ? 1 : 0;
        }
        ++counts.grids;
        counts.micropolygons += 1u << (r.grid.piece.grid_u + r.grid.piece.grid_v);
        next = is_diced;
      }
    } else if (work == is_diced) {
      const uint32_t n = shade_grid(b, r.grid, r.root, light, lane);
      for (uint32_t k = lane; k < n; k += 32) r.packed[k] = light.packed[k];
      counts.shaded += n;
      next = is_shaded;
    } else {
      const uint32_t num_points = 1u << (shaded_bits(r.grid.piece.grid_u, b.own.block_bits) +
                                         shaded_bits(r.grid.piece.grid_v, b.own.block_bits));
      for (uint32_t k = lane; k < num_points; k += 32) light.packed[k] = r.packed[k];
      __syncwarp();
      sample_quads<Look::OwnLight, Walk>(b, r.grid, r.in_front != 0, r.leaf, r.root, &light, nullptr, lane,
                                         counts.fragments);
    }
    if (has_leaves || work != is_free) {
      num_switches += work != last_work ? 1 : 0;
      last_work = work;
    }
    __syncwarp();
    if (lane == 0) {
      __threadfence_block();
      atomicExch(states + room, next);
    }
    __syncwarp();
  }
  counts.add_to(*b.numbers);
  if (lane == 0 && num_switches != 0)
    atomicAdd(&b.numbers->num_switches, static_cast<unsigned long long>(num_switches));
}

}  // namespace

void launch_uber_grids(const ReyesBatch &batch, cudaStream_t stream)
{
  const uint64_t n = uint64_t(batch.leaf_capacity) * 32;
  const char *name = "REYES stages 'dice', 'shade' and 'sample', by what waits";
  if (batch.samples.masks != nullptr) launch_persistent(name, dice_shade_sample<MaskWalk>, n, stream, batch);
  else launch_persistent(name, dice_shade_sample<TinyWalk>, n, stream, batch);
}

}  // namespace gpurt::cuda
