// Makes nodes of two levels from a kd-tree, and a list of its triangles that has each one once, in the order of leaves.
//
// Level by level: the children of a level's nodes follow them, in their order, so that the nodes do not depend on who comes
// first.
#include <cub/device/device_scan.cuh>

#include "core/accel/kd_quad_make.h"
#include "cuda/accel/build/kd_quad_kernels.h"
#include "cuda/launch.h"

namespace gpurt::cuda {
namespace {

__global__ void __launch_bounds__(block_size) count_kernel(QuadBuild b, uint32_t begin, uint32_t end)
{
  const uint64_t i = begin + thread_item();
  if (i < end) b.first[i] = kd_quad_children(b.tree.nodes, b.tree.nodes[b.node[i]]).count;
}

__global__ void __launch_bounds__(block_size)
    place_kernel(QuadBuild b, uint32_t begin, uint32_t end, const uint32_t *before)
{
  const uint64_t i = begin + thread_item();
  if (i >= end) return;
  const KdQuadChildren c = kd_quad_children(b.tree.nodes, b.tree.nodes[b.node[i]]);
  const uint32_t first = end + before[i - begin];
  b.first[i] = first;
  for (uint32_t k = 0; k < c.count; ++k) b.node[first + k] = c.node[k];
}

__global__ void __launch_bounds__(block_size)
    write_kernel(QuadBuild b, uint32_t num_slots, BvhFrame frame, KdQuadNode *slots)
{
  const uint64_t i = thread_item();
  if (i >= num_slots) return;
  slots[i] = make_kd_quad_node(b.tree.nodes, b.node[i], b.first[i], b.places, frame);
}

__global__ void __launch_bounds__(block_size)
    first_reference_kernel(const uint32_t *references, uint32_t num_references, uint32_t *first)
{
  const uint64_t i = thread_item();
  if (i < num_references) atomicMin(&first[references[i]], uint32_t(i));
}

__global__ void __launch_bounds__(block_size)
    flag_kernel(const uint32_t *references, uint32_t num_references, const uint32_t *first, uint32_t *flags)
{
  const uint64_t i = thread_item();
  if (i <= num_references) flags[i] = i < num_references && first[references[i]] == i ? 1u : 0u;
}

__global__ void __launch_bounds__(block_size)
    list_kernel(const uint32_t *references, uint32_t num_references, const uint32_t *first,
                const uint32_t *ranks, uint32_t *places, uint32_t *triangles)
{
  const uint64_t i = thread_item();
  if (i >= num_references) return;
  const uint32_t triangle = references[i], place = ranks[first[triangle]];
  places[i] = place;
  if (first[triangle] == i) triangles[place] = triangle;
}

}  // namespace

uint64_t quad_scan_bytes(uint32_t n)
{
  size_t bytes = 0;
  check(cub::DeviceScan::ExclusiveSum(nullptr, bytes, static_cast<const uint32_t *>(nullptr),
                                      static_cast<uint32_t *>(nullptr), int(n)),
        "cub::DeviceScan::ExclusiveSum");
  return bytes;
}

void launch_quad_scan(const uint32_t *from, uint32_t *to, uint32_t n, void *scratch, uint64_t scratch_bytes,
                      cudaStream_t stream)
{
  size_t bytes = scratch_bytes;
  check(cub::DeviceScan::ExclusiveSum(scratch, bytes, from, to, int(n), stream),
        "cub::DeviceScan::ExclusiveSum");
}

void launch_quad_count(const QuadBuild &build, uint32_t begin, uint32_t end, cudaStream_t stream)
{
  launch("kernel that counts a kd-tree's children", count_kernel, end - begin, stream, build, begin, end);
}

void launch_quad_place(const QuadBuild &build, uint32_t begin, uint32_t end, const uint32_t *before,
                       cudaStream_t stream)
{
  launch("kernel that places a kd-tree's children", place_kernel, end - begin, stream, build, begin, end,
         before);
}

void launch_quad_write(const QuadBuild &build, uint32_t num_slots, const BvhFrame &frame, KdQuadNode *slots,
                       cudaStream_t stream)
{
  launch("kernel that writes a kd-tree's nodes", write_kernel, num_slots, stream, build, num_slots, frame,
         slots);
}

void launch_first_references(const uint32_t *references, uint32_t num_references, uint32_t *first,
                             uint32_t num_triangles, uint32_t *flags, cudaStream_t stream)
{
  check(cudaMemsetAsync(first, 0xff, num_triangles * sizeof(uint32_t), stream), "cudaMemsetAsync");
  launch("kernel that finds triangles' first leaves", first_reference_kernel, num_references, stream,
         references, num_references, first);
  launch("kernel that flags triangles' first leaves", flag_kernel, uint64_t(num_references) + 1, stream,
         references, num_references, first, flags);
}

void launch_list_triangles(const uint32_t *references, uint32_t num_references, const uint32_t *first,
                           const uint32_t *ranks, uint32_t *places, uint32_t *triangles, cudaStream_t stream)
{
  launch("kernel that lists triangles by leaves", list_kernel, num_references, stream, references,
         num_references, first, ranks, places, triangles);
}

}  // namespace gpurt::cuda
