// Copies the triangles of a tree's leaves to where leaves read them: three 16-byte loads a triangle, in order.
#include "core/accel/kd_accel.h"
#include "cuda/accel/kernels.h"
#include "cuda/launch.h"

namespace gpurt::cuda {
namespace {

__global__ void __launch_bounds__(block_size)
    gather_kernel(const Vec3f *positions, const UInt3 *indices, uint32_t first_triangle,
                  const uint32_t *references, uint64_t num_references, LeafTriangle *triangles)
{
  const uint64_t i = thread_item();
  if (i >= num_references) return;
  const uint32_t triangle = first_triangle + references[i];
  const UInt3 corner = indices[triangle];
  triangles[i] = {positions[corner.x], triangle, positions[corner.y], 0, positions[corner.z], 0};
}

}  // namespace

void launch_gather_leaf_triangles(const SceneView &scene, uint32_t first_triangle, const uint32_t *references,
                                  uint64_t num_references, LeafTriangle *triangles, cudaStream_t stream)
{
  launch("kernel that gathers leaf triangles", gather_kernel, num_references, stream, scene.positions,
         scene.indices, first_triangle, references, num_references, triangles);
}

}  // namespace gpurt::cuda
