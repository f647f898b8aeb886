// The kernels that make nodes of two levels from a kd-tree, as host code calls them.
#pragma once

#include <cuda_runtime_api.h>

#include "core/accel/kd_quad.h"

namespace gpurt::cuda {

/// What they read and keep, in device memory.
struct QuadBuild {
  KdTreeView tree;
  const uint32_t *places;  // of the triangles that the tree's references name, in the list of triangles
  uint32_t *node;          // of the tree, by slot
  uint32_t *first;         // by slot: how many children it has, then the first one's slot
};

/// Bytes of scratch memory for the sums of n values.
uint64_t quad_scan_bytes(uint32_t n);
/// to[i] = from[0] + ... + from[i - 1].
void launch_quad_scan(const uint32_t *from, uint32_t *to, uint32_t n, void *scratch, uint64_t scratch_bytes,
                      cudaStream_t stream);
/// The slots begin to end - 1 are a level: counts their children; places these from `end` on, given the sums of the counts.
void launch_quad_count(const QuadBuild &build, uint32_t begin, uint32_t end, cudaStream_t stream);
void launch_quad_place(const QuadBuild &build, uint32_t begin, uint32_t end, const uint32_t *before,
                       cudaStream_t stream);
void launch_quad_write(const QuadBuild &build, uint32_t num_slots, const BvhFrame &frame, KdQuadNode *slots,
                       cudaStream_t stream);
/// first[t] = the first reference to triangle t; flags[i], num_references + 1 of them, whether reference i is one.
void launch_first_references(const uint32_t *references, uint32_t num_references, uint32_t *first,
                             uint32_t num_triangles, uint32_t *flags, cudaStream_t stream);
/// Given the sums of the flags: lists each triangle once, and where each reference's triangle is listed.
void launch_list_triangles(const uint32_t *references, uint32_t num_references, const uint32_t *first,
                           const uint32_t *ranks, uint32_t *places, uint32_t *triangles, cudaStream_t stream);

}  // namespace gpurt::cuda
