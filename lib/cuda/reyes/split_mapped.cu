// A level of stage 'split' whose pieces find their places by Map and Unmap, the talk's other way to write to a queue: every
// piece maps places for as many parts as there may be, writes those that there are, and the queue is unmapped: sums over
// what was written tell where each goes. Nothing is added atomically, and pieces keep their order.
#include "cuda/reyes/decide.h"
#include "cuda/reyes/split_schedules.h"

namespace gpurt::cuda {
namespace {

// Pieces of a level, of the lists as they were before it.
struct MappedLevel {
  PiecesOfLevel pieces;
  QueuedPiece *mapped;         // [most_parts * n], those of piece i from most_parts * i on
  uint32_t *parts;             // [n]: how many there are, and whether the first one is to be diced
  uint32_t *waits, *is_diced;  // flags of mapped, and of the pieces whose first part is to be diced
};

constexpr uint32_t dices = 8;  // in `parts`

__global__ void __launch_bounds__(split_threads)
    map_level(const __grid_constant__ ReyesBatch b, const __grid_constant__ MappedLevel level)
{
  static_assert(most_parts == group_lanes);
  __shared__ SharedPart parts[split_threads / group_lanes];
  const uint32_t thread = blockIdx.x * split_threads + threadIdx.x, lane = thread % group_lanes,
                 taker = thread / group_lanes;
  const bool has_piece = taker < level.pieces.from_stack + level.pieces.from_slots;
  QueuedPiece q = level.pieces.take(b, has_piece, taker);
  PieceAction action;
  const bool is_seen = decide(b, q, parts[threadIdx.x / group_lanes], lane, action);
  const bool is_diced = has_piece && is_seen && action == PieceAction::Dice,
             is_split = has_piece && is_seen && !is_diced;
  uint32_t n = 0;
  if (is_split) n = action == PieceAction::SplitBoth ? 4 : 2;
  if (has_piece) {
    // A lane a place.
    const uint32_t at = most_parts * taker + lane;
    level.waits[at] = lane < n ? 1 : 0;
    if (lane == 0) {
      level.is_diced[taker] = is_diced ? 1 : 0;
      level.parts[taker] = n | (is_diced ? dices : 0);
      if (is_diced) level.mapped[at] = q;
      if (is_split) {
        Piece pieces[most_parts];
        split_piece(q.piece, action, pieces);
        for (uint32_t i = 0; i < n; ++i) level.mapped[at + i] = {pieces[i], q.slot};
      }
    }
  }
  count_level(*b.numbers, has_piece && lane == 0 && !is_seen, is_split && lane == 0,
              is_split && lane == 0 && action == PieceAction::SplitBoth);
}

// A thread a mapped place.
__global__ void __launch_bounds__(block_size)
    unmap_level(const __grid_constant__ ReyesBatch b, const __grid_constant__ MappedLevel level, uint32_t n,
                const uint32_t *places, const uint32_t *leaf_places)
{
  const uint64_t i = thread_item();
  if (i >= uint64_t(n) * most_parts) return;
  const uint32_t piece = uint32_t(i / most_parts), k = uint32_t(i % most_parts), parts = level.parts[piece];
  if (k < parts % dices)
    b.stack[level.pieces.waiting - level.pieces.from_stack + places[i]] = level.mapped[i];
  if (k == 0 && (parts & dices) != 0)
    b.leaves[level.pieces.num_leaves + leaf_places[piece]] = level.mapped[i];
  if (i == 0) b.numbers->num_leaves = level.pieces.num_leaves + b.numbers->num_cut_leaves;
}

}  // namespace

MappedQueue MappedQueue::lay_out(Layout &layout, Compaction method, uint32_t stack_capacity)
{
  // As many as a level has of pieces (split_by_levels), and of their parts.
  const uint32_t n = max(stack_capacity / 2 / most_parts, 1u), num_parts = n * most_parts;
  MappedQueue m;
  m.method = method;
  m.parts = layout.take<uint32_t>(n);
  m.waits = layout.take<uint32_t>(num_parts);
  m.is_diced = layout.take<uint32_t>(n);
  m.places = layout.take<uint32_t>(num_parts);
  m.leaf_places = layout.take<uint32_t>(n);
  m.memory_bytes = placement_bytes(method, num_parts);
  m.memory = layout.take<std::byte>(m.memory_bytes);
  return m;
}

void split_mapped_level(const ReyesBatch &batch, const MappedQueue &m, const PiecesOfLevel &pieces,
                        QueuedPiece *mapped, cudaStream_t stream)
{
  const uint32_t n = pieces.from_stack + pieces.from_slots;
  const MappedLevel level{pieces, mapped, m.parts, m.waits, m.is_diced};
  launch_blocks("REYES stage 'split', a level mapped", map_level,
                (n * group_lanes + split_threads - 1) / split_threads, split_threads, stream, batch, level);
  launch_place({m.method, m.memory, m.memory_bytes, m.waits}, n * most_parts, m.places,
               &batch.numbers->pushed, stream);
  launch_place({m.method, m.memory, m.memory_bytes, m.is_diced}, n, m.leaf_places,
               &batch.numbers->num_cut_leaves, stream);
  launch("REYES' queue unmapped", unmap_level, uint64_t(n) * most_parts, stream, batch, level, n, m.places,
         m.leaf_places);
}

}  // namespace gpurt::cuda
