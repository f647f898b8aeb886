// A mesh in the memory of a CUDA device, for tests of what is built there.
#pragma once

#include <cuda_runtime_api.h>

#include "accel_test.h"
#include "cuda/device_memory.h"

namespace gpurt::test {

inline bool has_cuda()
{
  int count = 0;
  const bool found = cudaGetDeviceCount(&count) == cudaSuccess && count > 0;
  (void)cudaGetLastError();
  return found;
}

// A mesh in device memory, as a scene of one group.
struct DeviceMesh {
  DeviceMesh(const Mesh &mesh, const std::shared_ptr<cuda::DeviceMemory> &memory, cudaStream_t stream)
      : positions(cuda::upload(memory, std::span<const Vec3f>(mesh.positions), "positions", stream)),
        indices(cuda::upload(memory, std::span<const UInt3>(mesh.triangles), "indices", stream)),
        triangle_segments(
            cuda::upload(memory, std::span<const uint32_t>(std::vector<uint32_t>(mesh.triangles.size())),
                         "segments of triangles", stream)),
        segments(cuda::upload(memory, std::span<const Segment>(std::vector<Segment>(1)), "segments", stream))
  {
    view.positions = positions.data();
    view.indices = indices.data();
    view.triangle_segment = triangle_segments.data();
    view.segments = segments.data();
    group.num_triangles = uint32_t(mesh.triangles.size());
  }
  cuda::DeviceBuffer<Vec3f> positions;
  cuda::DeviceBuffer<UInt3> indices;
  cuda::DeviceBuffer<uint32_t> triangle_segments;
  cuda::DeviceBuffer<Segment> segments;  // one: the mesh
  SceneView view{};
  Group group{};
};

}  // namespace gpurt::test
