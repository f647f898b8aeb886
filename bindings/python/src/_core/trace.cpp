#include "arrays.h"
#include "objects.h"

namespace gpurt_python {

namespace {

void trace(const Scene &scene, int query, int format, const py::array &rays, const py::object &hits,
           const py::object &occluded, const py::object &offsets)
{
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.query = static_cast<gpurt_query>(query);
  desc.format = static_cast<gpurt_hit_format>(format);
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

}  // namespace

void bind_trace(py::class_<Scene> &scene)
{
  scene.def("trace", trace, py::arg("query"), py::arg("format"), py::arg("rays"), py::arg("hits"),
            py::arg("occluded"), py::arg("offsets"));
}

}  // namespace gpurt_python
