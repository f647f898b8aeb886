// Stage 'split' of one piece by a few lanes of a warp. For .cu files alone.
#pragma once

#include "cuda/launch.h"
#include "cuda/reyes/stages.h"

namespace gpurt::cuda {

constexpr unsigned split_threads = 256;
// Lanes that share a piece: few pieces wait at a time on small images, where the time of one decides.
constexpr uint32_t group_lanes = 4;
// Pieces that wait for their turn when the deepest one is cut, one at a time: a cut leaves three others behind.
constexpr uint32_t deepest_stack = 3 * (parameter_bits - smallest_piece_bits) + 4;

__device__ inline uint32_t lane_id() { return threadIdx.x % 32; }

// Adds `each` for every lane that takes part; the first one's place.
__device__ inline uint32_t take_places(uint32_t *counter, bool takes, uint32_t each)
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
__device__ inline float group_max(float x)
{
  x = max(x, __shfl_xor_sync(0xffffffffu, x, 1));
  return max(x, __shfl_xor_sync(0xffffffffu, x, 2));
}

// As coarsen_grid, by the lanes of a group together; they have the control points in homogeneous coordinates and, where the
// piece is in front of the eye, on the image. All lanes of the warp call it: of those that `may` the grids change.
__device__ inline void group_coarsen_grid(const SharedPart &part, const DiceSettings &dice, float length_u,
                                          float length_v, bool may, uint32_t lane, Piece &p)
{
  ProjectedBox box{infinity, infinity, -infinity, -infinity, infinity};
  for (uint32_t i = 4 * lane; i < 4 * lane + 4; ++i) {
    box.x0 = min(box.x0, part.px[i]);
    box.x1 = max(box.x1, part.px[i]);
    box.y0 = min(box.y0, part.py[i]);
    box.y1 = max(box.y1, part.py[i]);
    box.least_w = min(box.least_w, part.w[i]);
  }
  box = {-group_max(-box.x0), -group_max(-box.y0), group_max(box.x1), group_max(box.y1),
         -group_max(-box.least_w)};
  const SecondDifferences d = second_differences(projected_hull(box), part.x, part.y, part.w, int(lane));
  const SecondDifferences all{group_max(d.uu), group_max(d.uv), group_max(d.vv)};
  if (may) coarsen_grid(all, box.least_w, dice, length_u, length_v, p);
}

// As decide_piece, by the lanes of a group together: a lane takes a coordinate, a row, an edge. False: it cannot be seen.
// All lanes of the warp call it; groups with the same piece everywhere.
__device__ inline bool decide(const ReyesBatch &b, QueuedPiece &q, SharedPart &part, uint32_t lane,
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
  if (is_in_front)
    polygon_lengths(part.px, part.py, part.w, 0.0f, int(lane), b.dice.inv_edge, length_u, length_v);
  else
    polygon_lengths(part.x, part.y, part.w, b.dice.half_width, int(lane), b.dice.inv_edge, length_u,
                    length_v);
  length_u = group_max(length_u);
  length_v = group_max(length_v);
  action = choose_action(p, is_in_front, length_u, length_v, b.dice);
  const bool may_be_flat =
      is_seen && action == PieceAction::Dice && is_in_front && may_be_coarser(p, length_u, length_v, b.dice);
  if (__any_sync(0xffffffffu, may_be_flat))
    group_coarsen_grid(part, b.dice, length_u, length_v, may_be_flat, lane, p);
  __syncwarp();
  return is_seen;
}

// Counts what lanes of a warp have cut: pieces that cannot be seen, that were cut in two, and of these in four.
__device__ inline void count_level(ReyesNumbers &numbers, bool is_culled, bool is_split, bool is_both)
{
  const uint32_t culled = __ballot_sync(0xffffffffu, is_culled), split = __ballot_sync(0xffffffffu, is_split),
                 both = __ballot_sync(0xffffffffu, is_both);
  if (lane_id() != 0) return;
  if (culled != 0) atomicAdd(&numbers.num_culled, (unsigned long long)__popc(culled));
  if (split != 0) atomicAdd(&numbers.num_splits, (unsigned long long)(__popc(split) + 2 * __popc(both)));
}

// As many blocks of a kernel of split_threads as a device holds, up to `most` on each multiprocessor.
unsigned resident_split_blocks(const void *kernel, int most);

}  // namespace gpurt::cuda
