// Photon maps: addresses of host or device memory, which the package has checked, to the C library.
#include "arrays.h"
#include "gpurt_cuda.h"
#include "objects.h"

namespace gpurt_python {

namespace {

const float *floats(std::uintptr_t address) { return reinterpret_cast<const float *>(address); }

std::unique_ptr<PhotonMap> create(const Device &device, bool in_device_memory, uint64_t num_points,
                                  std::uintptr_t positions, std::uintptr_t fluxes, std::uintptr_t normals,
                                  float radius, uint32_t num_levels)
{
  auto map = std::make_unique<PhotonMap>();
  gpurt_photon_map_desc desc = GPURT_PHOTON_MAP_DESC_INIT;
  desc.storage = in_device_memory ? GPURT_STORAGE_DEVICE : GPURT_STORAGE_HOST;
  desc.num_points = num_points;
  desc.positions = floats(positions);
  desc.fluxes = floats(fluxes);
  desc.normals = floats(normals);
  desc.radius = radius;
  desc.num_levels = num_levels;
  call([&] { return gpurt_photon_map_create(device.handle.get(), &desc, map->handle.out()); });
  return map;
}

std::unique_ptr<PhotonMap> trace(const Scene &scene, uint32_t num_paths, uint64_t seed, uint64_t pass,
                                 uint32_t frame_index, uint32_t max_depth, float radius, uint32_t num_levels)
{
  auto map = std::make_unique<PhotonMap>();
  gpurt_photon_trace_desc desc = GPURT_PHOTON_TRACE_DESC_INIT;
  desc.num_paths = num_paths;
  desc.seed = seed;
  desc.pass = pass;
  desc.frame_index = frame_index;
  desc.max_depth = max_depth;
  desc.radius = radius;
  desc.num_levels = num_levels;
  call([&] { return gpurt_photon_map_trace(scene.handle.get(), &desc, map->handle.out()); });
  return map;
}

void read(const PhotonMap &map, int attribute, std::uintptr_t data, uint64_t size_bytes)
{
  call([&] {
    return gpurt_photon_map_read(map.handle.get(), static_cast<gpurt_photon_attribute>(attribute),
                                 reinterpret_cast<void *>(data), size_bytes);
  });
}

std::unique_ptr<PhotonMap> load(const Device &device, const py::bytes &path)
{
  auto map = std::make_unique<PhotonMap>();
  const std::string text = to_path(path);
  call([&] { return gpurt_photon_map_load(device.handle.get(), text.c_str(), map->handle.out()); });
  return map;
}

void save(const PhotonMap &map, const py::bytes &path)
{
  const std::string text = to_path(path);
  call([&] { return gpurt_photon_map_save(map.handle.get(), text.c_str()); });
}

py::dict info(const PhotonMap &map)
{
  using namespace py::literals;
  gpurt_photon_map_info info = GPURT_PHOTON_MAP_INFO_INIT;
  call([&] { return gpurt_photon_map_get_info(map.handle.get(), &info); });
  return py::dict("num_points"_a = info.num_points, "num_levels"_a = info.num_levels,
                  "bounds_min"_a = to_tuple(info.bounds[0]), "bounds_max"_a = to_tuple(info.bounds[1]),
                  "radius"_a = info.radius, "has_fluxes"_a = info.has_fluxes != 0,
                  "has_normals"_a = info.has_normals != 0, "fullest_cell"_a = info.fullest_cell,
                  "memory_bytes"_a = info.memory_bytes, "build_seconds"_a = info.build_seconds,
                  "has_directions"_a = info.has_directions != 0, "num_paths"_a = info.num_paths);
}

// A stream, which None is not: the work is queued there and not waited for.
void query(const PhotonMap &map, int kind, int method, int kernel, bool in_device_memory,
           uint64_t num_queries, std::uintptr_t positions, std::uintptr_t normals, float min_cosine,
           float radius, float radius_hint, uint32_t k, std::uintptr_t counts, std::uintptr_t sums,
           std::uintptr_t offsets, std::uintptr_t ids, std::uintptr_t distances, uint64_t capacity,
           const py::object &stream)
{
  gpurt_photon_query_desc desc = GPURT_PHOTON_QUERY_DESC_INIT;
  desc.query = static_cast<gpurt_photon_query>(kind);
  desc.method = static_cast<gpurt_gather_method>(method);
  desc.kernel = static_cast<gpurt_gather_kernel>(kernel);
  desc.storage = in_device_memory ? GPURT_STORAGE_DEVICE : GPURT_STORAGE_HOST;
  desc.num_queries = num_queries;
  desc.positions = floats(positions);
  desc.normals = floats(normals);
  desc.min_cosine = min_cosine;
  desc.radius = radius;
  desc.radius_hint = radius_hint;
  desc.k = k;
  desc.counts = reinterpret_cast<uint32_t *>(counts);
  desc.sums = reinterpret_cast<float *>(sums);
  desc.offsets = reinterpret_cast<uint64_t *>(offsets);
  desc.ids = reinterpret_cast<uint32_t *>(ids);
  desc.distances = reinterpret_cast<float *>(distances);
  desc.capacity = capacity;
  if (stream.is_none()) {
    call([&] { return gpurt_photon_map_query(map.handle.get(), &desc); });
  } else {
    auto *const handle = reinterpret_cast<void *>(stream.cast<std::uintptr_t>());
    call([&] { return gpurt_cuda_query_photons(map.handle.get(), &desc, handle, nullptr, nullptr); });
  }
}

}  // namespace

void bind_photons(py::module_ &module)
{
  py::class_<PhotonMap>(module, "PhotonMap")
      .def(py::init(&create), py::arg("device"), py::arg("in_device_memory"), py::arg("num_points"),
           py::arg("positions"), py::arg("fluxes"), py::arg("normals"), py::arg("radius"),
           py::arg("num_levels"))
      .def_static("trace", trace, py::arg("scene"), py::arg("num_paths"), py::arg("seed"),
                  py::arg("pass_index"), py::arg("frame_index"), py::arg("max_depth"), py::arg("radius"),
                  py::arg("num_levels"))
      .def("read", read, py::arg("attribute"), py::arg("data"), py::arg("size_bytes"))
      .def_static("load", load, py::arg("device"), py::arg("path"))
      .def("save", save, py::arg("path"))
      .def("info", info)
      .def("query", query, py::arg("kind"), py::arg("method"), py::arg("kernel"), py::arg("in_device_memory"),
           py::arg("num_queries"), py::arg("positions"), py::arg("normals"), py::arg("min_cosine"),
           py::arg("radius"), py::arg("radius_hint"), py::arg("k"), py::arg("counts"), py::arg("sums"),
           py::arg("offsets"), py::arg("ids"), py::arg("distances"), py::arg("capacity"), py::arg("stream"));
}

}  // namespace gpurt_python
