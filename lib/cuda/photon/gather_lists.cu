// Gathers from the lists of a kd-tree's leaves, a thread a query: the reference that the grid is compared with.
#include "cuda/launch.h"
#include "cuda/photon/kernels.h"

namespace gpurt::cuda {
namespace {

__global__ void __launch_bounds__(block_size)
    gather_lists_kernel(const __grid_constant__ ListGather gather, uint64_t num_queries)
{
  const uint64_t query = thread_item();
  if (query < num_queries) answer_from_lists(gather, query);
}

}  // namespace

void launch_gather_lists(const ListGather &gather, uint64_t num_queries, cudaStream_t stream)
{
  launch("kernel that gathers photons from lists", gather_lists_kernel, num_queries, stream, gather,
         num_queries);
}

}  // namespace gpurt::cuda
