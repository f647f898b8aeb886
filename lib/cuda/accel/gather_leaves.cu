// Copies the triangles of a tree's leaves to where leaves read them: three 16-byte loads a triangle, in order.
#include "core/accel/kd_accel.h"
#include "cuda/accel/kernels.h"
#include "cuda/launch.h"

namespace gpurt::cuda {
namespace {

__global__ void __launch_bounds__(block_size)
    gather_kernel(const __grid_constant__ SceneView scene, uint32_t first_triangle,
                  const uint32_t *references, uint64_t num_references, LeafTriangle *triangles)
{
  const uint64_t i = thread_item();
  if (i >= num_references) return;
  const uint32_t triangle = first_triangle + references[i];
  const UInt3 corner = scene.indices[triangle];
  const uint32_t segment = scene.triangle_segment[triangle];
  const uint32_t primitive = triangle - scene.segments[segment].first_triangle;
  triangles[i] = {scene.positions[corner.x], triangle, scene.positions[corner.y], primitive,
                  scene.positions[corner.z], segment};
}

}  // namespace

void launch_gather_leaf_triangles(const SceneView &scene, uint32_t first_triangle, const uint32_t *references,
                                  uint64_t num_references, LeafTriangle *triangles, cudaStream_t stream)
{
  launch("kernel that gathers leaf triangles", gather_kernel, num_references, stream, scene, first_triangle,
         references, num_references, triangles);
}

}  // namespace gpurt::cuda
