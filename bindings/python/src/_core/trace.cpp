#include "arrays.h"
#include "gpurt_cuda.h"
#include "objects.h"

namespace gpurt_python {

namespace {

void trace(const Scene &scene, int query, int format, const py::array &rays, const py::object &hits,
           const py::object &occluded, const py::object &offsets, int coherence, uint32_t image_width)
{
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.query = static_cast<gpurt_query>(query);
  desc.format = static_cast<gpurt_hit_format>(format);
  desc.coherence = static_cast<gpurt_coherence>(coherence);
  desc.image_width = image_width;
  desc.num_rays = static_cast<uint64_t>(rays.nbytes()) / sizeof(gpurt_ray);
  desc.rays = static_cast<const gpurt_ray *>(packed_data(rays, desc.num_rays * sizeof(gpurt_ray), "rays"));
  const uint64_t hit_bytes = desc.format == GPURT_HIT_FULL ? sizeof(gpurt_hit) : sizeof(gpurt_hit_compact);
  if (!hits.is_none()) {
    desc.hit_capacity = desc.query == GPURT_QUERY_ALL ? static_cast<uint64_t>(py::len(hits)) : 0;
    desc.hits = packed_output(
        hits, (desc.query == GPURT_QUERY_ALL ? desc.hit_capacity : desc.num_rays) * hit_bytes, "hits");
  }
  desc.occluded = static_cast<uint8_t *>(packed_output(occluded, desc.num_rays, "occluded"));
  desc.offsets =
      static_cast<uint64_t *>(packed_output(offsets, (desc.num_rays + 1) * sizeof(uint64_t), "offsets"));
  call([&] { return gpurt_scene_trace(scene.handle.get(), &desc); });
}

// The same with addresses, of host or device memory, which the caller has checked. A stream, which None is not: the work
// is queued there and not waited for.
void trace_memory(const Scene &scene, int query, int format, bool in_device_memory, uint64_t num_rays,
                  std::uintptr_t rays, std::uintptr_t hits, uint64_t hit_capacity, std::uintptr_t occluded,
                  std::uintptr_t offsets, const py::object &stream, int coherence, uint32_t image_width)
{
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.query = static_cast<gpurt_query>(query);
  desc.format = static_cast<gpurt_hit_format>(format);
  desc.coherence = static_cast<gpurt_coherence>(coherence);
  desc.image_width = image_width;
  desc.storage = in_device_memory ? GPURT_STORAGE_DEVICE : GPURT_STORAGE_HOST;
  desc.num_rays = num_rays;
  desc.rays = reinterpret_cast<const gpurt_ray *>(rays);
  desc.hits = reinterpret_cast<void *>(hits);
  desc.hit_capacity = hit_capacity;
  desc.occluded = reinterpret_cast<uint8_t *>(occluded);
  desc.offsets = reinterpret_cast<uint64_t *>(offsets);
  if (stream.is_none()) {
    call([&] { return gpurt_scene_trace(scene.handle.get(), &desc); });
  } else {
    auto *const handle = reinterpret_cast<void *>(stream.cast<std::uintptr_t>());
    call([&] { return gpurt_cuda_trace(scene.handle.get(), &desc, handle, nullptr, nullptr); });
  }
}

void locate(const Scene &scene, int format, const py::array &hits, uint32_t geometry, uint32_t instance,
            const py::array &points, const py::object &positions, const py::object &normals)
{
  gpurt_locate_desc desc = GPURT_LOCATE_DESC_INIT;
  desc.format = static_cast<gpurt_hit_format>(format);
  const uint64_t hit_bytes = desc.format == GPURT_HIT_FULL ? sizeof(gpurt_hit) : sizeof(gpurt_hit_compact);
  desc.num_hits = static_cast<uint64_t>(hits.nbytes()) / hit_bytes;
  desc.hits = packed_data(hits, desc.num_hits * hit_bytes, "hits");
  desc.geometry = geometry;
  desc.instance = instance;
  desc.points = static_cast<gpurt_patch_point *>(
      packed_output(points, desc.num_hits * sizeof(gpurt_patch_point), "points"));
  const uint64_t vector_bytes = desc.num_hits * 3 * sizeof(float);
  desc.positions = static_cast<float *>(packed_output(positions, vector_bytes, "positions"));
  desc.normals = static_cast<float *>(packed_output(normals, vector_bytes, "normals"));
  call([&] { return gpurt_scene_locate(scene.handle.get(), &desc); });
}

}  // namespace

void bind_trace(py::class_<Scene> &scene)
{
  scene.def("trace", trace, py::arg("query"), py::arg("format"), py::arg("rays"), py::arg("hits"),
            py::arg("occluded"), py::arg("offsets"), py::arg("coherence"), py::arg("image_width"));
  scene.def("trace_memory", trace_memory, py::arg("query"), py::arg("format"), py::arg("in_device_memory"),
            py::arg("num_rays"), py::arg("rays"), py::arg("hits"), py::arg("hit_capacity"),
            py::arg("occluded"), py::arg("offsets"), py::arg("stream"), py::arg("coherence"),
            py::arg("image_width"));
  scene.def("locate", locate, py::arg("format"), py::arg("hits"), py::arg("geometry"), py::arg("instance"),
            py::arg("points"), py::arg("positions"), py::arg("normals"));
}

}  // namespace gpurt_python
