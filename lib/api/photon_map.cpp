// gpurt_photon_map_* and gpurt_cuda_query_photons: check the request, hand it to the backend's map.
#include "photon_maps.h"

#include <cstring>

#include "api/descriptor.h"
#include "api/guard.h"
#include "api/memory_range.h"
#include "api/objects.h"
#include "api/photon_file.h"
#include "gpurt_cuda.h"
#include "planner/plan.h"
#include "scene/emission_table.h"

namespace gpurt::api {
namespace {

// Radii whose squares are normal floats.
constexpr float min_radius = 0x1.8p-63f, max_radius = 0x1.fp63f;

void check_radius(float radius, const char *name)
{
  if (radius >= min_radius && radius <= max_radius) return;
  fail_invalid("{} is {:g}; it must lie in [{:g}, {:g}], where its square is a float", name, radius,
               min_radius, max_radius);
}

bool is_device_memory(gpurt_storage storage, const Device &device)
{
  return storage == GPURT_STORAGE_DEVICE && !device.is_cpu();
}

std::shared_ptr<PhotonMapObject> make_map(std::shared_ptr<Device> device, const PhotonMapRequest &request)
{
  auto *const maps = dynamic_cast<PhotonMaps *>(device->backend.get());
  if (!maps) {
    fail(GPURT_ERROR_UNSUPPORTED, "this version has no photon maps on the {} device; use a CPU device",
         device->is_cpu() ? "CPU" : "CUDA");
  }
  auto object = std::make_shared<PhotonMapObject>();
  object->map = maps->make_photon_map(request);
  object->device = std::move(device);
  return object;
}

uint32_t checked_levels(uint32_t num_levels)
{
  if (num_levels > max_photon_levels)
    fail_invalid("num_levels is {}; a map has at most {}", num_levels, max_photon_levels);
  return num_levels == 0 ? 1 : num_levels;
}

// A map's points and what they are, as files have them.
PhotonFile read_points(const PhotonMapObject &object)
{
  const PhotonMapFacts &facts = object.map->facts();
  PhotonFile file;
  // Host memory is what the CPU device's limit is about.
  if (object.device->is_cpu()) {
    file.reservation =
        Reservation(object.device->memory(), facts.num_points * sizeof(Photon), "a copy of the points");
  }
  file.records.resize(facts.num_points);
  file.radius = facts.radius;
  file.num_levels = facts.num_levels;
  file.has_fluxes = facts.has_fluxes;
  file.has_normals = facts.has_normals;
  file.flux_scale = facts.flux_scale;
  file.num_paths = facts.num_paths;
  object.map->read(file.records.data());
  return file;
}

PhotonMapRequest checked_request(const gpurt_photon_map_desc &d, const Device &device)
{
  check_enum(d.storage, GPURT_STORAGE_DEVICE + 1, "storage", "gpurt_storage");
  if (d.num_points > max_photons)
    fail_invalid("num_points is {}; a map holds at most {}", d.num_points, max_photons);
  const auto points = [&](const char *name, const float *data) {
    checked_range(name, data, d.num_points, sizeof(Vec3f), alignof(float));
    return d.num_points != 0 ? reinterpret_cast<const Vec3f *>(data) : nullptr;
  };
  PhotonMapRequest request;
  request.source = {nullptr, points("positions", d.positions),
                    d.fluxes ? points("fluxes", d.fluxes) : nullptr,
                    d.normals ? points("normals", d.normals) : nullptr, d.num_points};
  request.has_fluxes = d.fluxes != nullptr;
  request.has_normals = d.normals != nullptr;
  request.device_memory = is_device_memory(d.storage, device);
  if (d.radius != 0) check_radius(d.radius, "radius");
  request.radius = d.radius;
  request.num_levels = checked_levels(d.num_levels);
  return request;
}

ScenePhotonRequest checked_request(const gpurt_photon_trace_desc &d)
{
  constexpr uint32_t default_paths = uint32_t(1) << 20;
  if (d.num_paths > max_photons) fail_invalid("num_paths is {}; at most {}", d.num_paths, max_photons);
  if (d.max_depth > max_photon_depth)
    fail_invalid("max_depth is {}; photon mapping has at most {}", d.max_depth, max_photon_depth);
  if (d.pass == pilot_pass) fail_invalid("pass is {}; passes end before it", d.pass);
  if (d.radius != 0) check_radius(d.radius, "radius");
  return {d.num_paths != 0 ? d.num_paths : default_paths, d.pass, d.radius, checked_levels(d.num_levels)};
}

std::shared_ptr<PhotonMapObject> trace_map(const Scene &scene, const gpurt_photon_trace_desc &d)
{
  const std::shared_ptr<const Commit> commit = scene.require_commit();
  const ScenePhotonRequest request = checked_request(d);
  commit->committed->require_photons();
  const EmissionTable emission = make_emission_table(*commit->compiled);
  if (emission.cdf.empty()) {
    fail_invalid(
        "the scene has no light that emits photons; add a light, an emissive material or an environment and "
        "commit it");
  }
  PathSettings settings{};
  settings.seed = d.seed;
  settings.frame_index = d.frame_index;
  settings.max_depth = d.max_depth != 0 ? d.max_depth : default_max_depth;
  auto object = std::make_shared<PhotonMapObject>();
  object->device = scene.device;
  try {
    object->map = commit->committed->photon_map(settings, emission.view(), request);
  } catch (const Error &e) {
    if (e.result() != GPURT_ERROR_OUT_OF_MEMORY) throw;
    fail(GPURT_ERROR_OUT_OF_MEMORY, "a map of {} photon paths: {}, or emit fewer num_paths",
         request.num_paths, e.what());
  }
  return object;
}

// Three values of an attribute of a point.
Vec3f attribute_of(const Photon &record, gpurt_photon_attribute attribute, float flux_scale)
{
  const auto byte = [&](int shift) { return float(int8_t(record.normal >> shift)) * (1.0f / 127.0f); };
  switch (attribute) {
    case GPURT_PHOTON_ATTRIBUTE_FLUX:
      return decode_flux(record.flux) * flux_scale;
    case GPURT_PHOTON_ATTRIBUTE_NORMAL:
      return {byte(0), byte(8), byte(16)};
    case GPURT_PHOTON_ATTRIBUTE_DIRECTION:
      return decode_direction(record.direction);
    default:
      return record.position;
  }
}

void read_map(const PhotonMapObject &object, gpurt_photon_attribute attribute, void *data,
              uint64_t size_bytes)
{
  const PhotonMapFacts &facts = object.map->facts();
  if (attribute == GPURT_PHOTON_ATTRIBUTE_FLUX && !facts.has_fluxes)
    fail_invalid("attribute is GPURT_PHOTON_ATTRIBUTE_FLUX, but the map was made without fluxes");
  if (attribute == GPURT_PHOTON_ATTRIBUTE_NORMAL && !facts.has_normals)
    fail_invalid("attribute is GPURT_PHOTON_ATTRIBUTE_NORMAL, but the map was made without normals");
  if (attribute == GPURT_PHOTON_ATTRIBUTE_DIRECTION && facts.num_paths == 0) {
    fail_invalid(
        "attribute is GPURT_PHOTON_ATTRIBUTE_DIRECTION, but the points are the caller's, which have none; "
        "gpurt_photon_map_trace makes maps that have them");
  }
  if (size_bytes != facts.num_points * sizeof(Vec3f)) {
    fail_invalid("size_bytes is {}; {} points of 12 bytes take {}", size_bytes, facts.num_points,
                 facts.num_points * sizeof(Vec3f));
  }
  if (facts.num_points == 0) return;
  require(data, "data");
  const PhotonFile file = read_points(object);
  auto *to = static_cast<std::byte *>(data);
  for (const Photon &record : file.records) {
    const Vec3f value = attribute_of(record, attribute, facts.flux_scale);
    std::memcpy(to, &value, sizeof value);
    to += sizeof value;
  }
}

const char *name_of(PhotonQueryKind kind)
{
  switch (kind) {
    case PhotonQueryKind::Count:
      return "GPURT_PHOTON_QUERY_COUNT";
    case PhotonQueryKind::Sum:
      return "GPURT_PHOTON_QUERY_SUM";
    case PhotonQueryKind::List:
      return "GPURT_PHOTON_QUERY_LIST";
    case PhotonQueryKind::Nearest:
      return "GPURT_PHOTON_QUERY_NEAREST";
  }
  return "this query";
}

// The arrays of a query, of which those written overlap nothing.
class QueryArrays {
 public:
  void add_read(const char *name, const void *data, uint64_t count, uint64_t bytes)
  {
    add(checked_range(name, data, count, bytes, alignof(float)), false);
  }
  void add_written(const char *name, const void *data, uint64_t count, uint64_t bytes, size_t alignment)
  {
    add(checked_range(name, data, count, bytes, alignment), true);
  }

 private:
  void add(const Range &range, bool is_written)
  {
    for (size_t i = 0; i < num_; ++i) {
      if (is_written || is_written_[i]) check_disjoint(ranges_[i], range);
    }
    ranges_[num_] = range;
    is_written_[num_++] = is_written;
  }

  Range ranges_[8] = {};
  bool is_written_[8] = {};
  size_t num_ = 0;
};

uint64_t times(uint64_t a, uint64_t b)
{
  uint64_t product;
  if (__builtin_mul_overflow(a, b, &product))
    fail_invalid("num_queries is {}; that many results cannot be counted", a);
  return product;
}

PhotonQuery checked_query(const gpurt_photon_query_desc &d, const PhotonMapFacts &facts, const Device &device)
{
  check_enum(d.query, GPURT_PHOTON_QUERY_NEAREST + 1, "query", "gpurt_photon_query");
  check_enum(d.storage, GPURT_STORAGE_DEVICE + 1, "storage", "gpurt_storage");
  check_enum(d.kernel, GPURT_GATHER_KERNEL_QUADRATIC + 1, "kernel", "gpurt_gather_kernel");
  check_enum(d.coherence, GPURT_COHERENCE_INCOHERENT + 1, "coherence", "gpurt_coherence");
  check_enum(d.method, GPURT_GATHER_NODE_LISTS + 1, "method", "gpurt_gather_method");
  PhotonQuery query;
  query.kind = PhotonQueryKind(d.query);
  query.method = GatherMethod(d.method);
  query.device_memory = is_device_memory(d.storage, device);
  query.is_coherent = d.coherence == GPURT_COHERENCE_COHERENT;
  query.num_queries = d.num_queries;
  query.positions = reinterpret_cast<const Vec3f *>(d.positions);
  query.normals = reinterpret_cast<const Vec3f *>(d.normals);
  query.counts = d.counts;
  query.sums = reinterpret_cast<Vec3f *>(d.sums);
  query.offsets = d.offsets;
  query.ids = d.ids;
  query.distances = d.distances;
  query.capacity = d.capacity;
  const char *const name = name_of(query.kind);
  const bool is_nearest = query.kind == PhotonQueryKind::Nearest,
             is_list = query.kind == PhotonQueryKind::List;

  if (!is_nearest || d.radius != 0) check_radius(d.radius, "radius");
  if (is_nearest) {
    if (d.k == 0 || d.k > GPURT_MAX_NEAREST)
      fail_invalid("k is {}; it must be 1 to {}", d.k, GPURT_MAX_NEAREST);
    if (d.radius_hint != 0) check_radius(d.radius_hint, "radius_hint");
    if (query.method != GatherMethod::Grid)
      fail_invalid("method is GPURT_GATHER_NODE_LISTS, which has lists for radii; {} needs GPURT_GATHER_GRID",
                   name);
    check_absent(d.normals, "normals", name);
    query.k = d.k;
    query.limit = d.radius != 0 ? d.radius : infinity;
    query.hint = d.radius_hint;
  } else {
    query.range = make_range_query(d.radius, GatherKernel(d.kernel), d.min_cosine, facts.flux_scale);
  }
  if (d.normals) {
    if (!(d.min_cosine >= -1 && d.min_cosine <= 1))
      fail_invalid("min_cosine is {:g}; it must lie in [-1, 1]", d.min_cosine);
    if (!facts.has_normals)
      fail_invalid(
          "normals are given, but the map was made without them; give normals to gpurt_photon_map_create");
  }
  if (query.kind == PhotonQueryKind::Sum && !facts.has_fluxes)
    fail_invalid("{} needs fluxes, and the map was made without them; give them to gpurt_photon_map_create",
                 name);

  QueryArrays arrays;
  arrays.add_read("positions", d.positions, d.num_queries, sizeof(Vec3f));
  if (d.normals) arrays.add_read("normals", d.normals, d.num_queries, sizeof(Vec3f));
  if (query.kind != PhotonQueryKind::Sum) check_absent(d.sums, "sums", name);
  if (!is_list) check_absent(d.offsets, "offsets", name);
  if (!is_list && !is_nearest) {
    check_absent(d.ids, "ids", name);
    check_absent(d.distances, "distances", name);
  }
  if (is_list) {
    check_absent(d.counts, "counts", name);
    if (d.num_queries == UINT64_MAX)
      fail_invalid("num_queries is {}; that many cannot be counted", d.num_queries);
    arrays.add_written("offsets", d.offsets, d.num_queries + 1, sizeof(uint64_t), alignof(uint64_t));
  }
  if (query.kind == PhotonQueryKind::Count || d.counts)
    arrays.add_written("counts", d.counts, d.num_queries, sizeof(uint32_t), alignof(uint32_t));
  if (query.kind == PhotonQueryKind::Sum)
    arrays.add_written("sums", d.sums, d.num_queries, sizeof(Vec3f), alignof(float));
  const uint64_t num_results = is_list ? d.capacity : times(d.num_queries, query.k);
  if ((is_nearest && !d.distances) || d.ids)
    arrays.add_written("ids", d.ids, num_results, sizeof(uint32_t), alignof(uint32_t));
  if (d.distances) arrays.add_written("distances", d.distances, num_results, sizeof(float), alignof(float));
  return query;
}

}  // namespace
}  // namespace gpurt::api

using namespace gpurt;
using namespace gpurt::api;

gpurt_result gpurt_photon_map_create(gpurt_device device, const gpurt_photon_map_desc *desc,
                                     gpurt_photon_map *out_map)
{
  return guard([&] {
    const auto parent = get(device, "device");
    require(out_map, "out_map");
    const gpurt_photon_map_desc d = read_descriptor(desc);
    *out_map = publish<gpurt_photon_map>(make_map(parent, checked_request(d, *parent)));
  });
}

gpurt_result gpurt_photon_map_trace(gpurt_scene scene, const gpurt_photon_trace_desc *desc,
                                    gpurt_photon_map *out_map)
{
  return guard([&] {
    const auto s = get(scene, "scene");
    require(out_map, "out_map");
    *out_map = publish<gpurt_photon_map>(trace_map(*s, read_optional_descriptor(desc)));
  });
}

gpurt_result gpurt_photon_map_read(gpurt_photon_map map, gpurt_photon_attribute attribute, void *data,
                                   uint64_t size_bytes)
{
  return guard([&] {
    const auto object = get(map, "map");
    check_enum(attribute, GPURT_PHOTON_ATTRIBUTE_DIRECTION + 1, "attribute", "gpurt_photon_attribute");
    read_map(*object, attribute, data, size_bytes);
  });
}

gpurt_result gpurt_photon_map_retain(gpurt_photon_map map)
{
  return guard([&] { retain(map, "map"); });
}

gpurt_result gpurt_photon_map_release(gpurt_photon_map map)
{
  return guard([&] { release(map, "map"); });
}

gpurt_result gpurt_photon_map_get_info(gpurt_photon_map map, gpurt_photon_map_info *out_info)
{
  return guard([&] {
    const auto object = get(map, "map");
    check_output(out_info, "out_info");
    const PhotonMapFacts &facts = object->map->facts();
    gpurt_photon_map_info info = GPURT_PHOTON_MAP_INFO_INIT;
    info.num_levels = facts.num_levels;
    info.num_points = facts.num_points;
    if (facts.num_points != 0) {
      for (int axis = 0; axis < 3; ++axis) {
        info.bounds[0][axis] = at(facts.bounds.lo, axis);
        info.bounds[1][axis] = at(facts.bounds.hi, axis);
      }
    }
    info.radius = facts.radius;
    info.has_fluxes = facts.has_fluxes;
    info.has_normals = facts.has_normals;
    info.fullest_cell = facts.fullest_cell;
    info.memory_bytes = facts.bytes;
    info.build_seconds = facts.build_seconds;
    info.has_directions = facts.num_paths != 0;
    info.num_paths = facts.num_paths;
    write_output(out_info, info, "out_info");
  });
}

gpurt_result gpurt_photon_map_save(gpurt_photon_map map, const char *path)
{
  return guard([&] {
    const auto object = get(map, "map");
    require(path, "path");
    write_photon_file(path, read_points(*object));
  });
}

gpurt_result gpurt_photon_map_load(gpurt_device device, const char *path, gpurt_photon_map *out_map)
{
  return guard([&] {
    const auto parent = get(device, "device");
    require(path, "path");
    require(out_map, "out_map");
    const PhotonFile file = read_photon_file(path, parent->is_cpu() ? parent->memory() : nullptr);
    if (!(file.radius >= min_radius && file.radius <= max_radius) || file.num_levels < 1 ||
        file.num_levels > max_photon_levels)
      fail(GPURT_ERROR_IO, "{}: damaged: its radius is {:g} and it has {} levels", path, file.radius,
           file.num_levels);
    PhotonMapRequest request;
    request.source = {file.records.data(), nullptr, nullptr, nullptr, file.records.size()};
    request.has_fluxes = file.has_fluxes;
    request.has_normals = file.has_normals;
    request.radius = file.radius;
    request.num_levels = file.num_levels;
    request.flux_scale = file.flux_scale;
    request.num_paths = file.num_paths;
    *out_map = publish<gpurt_photon_map>(make_map(parent, request));
  });
}

gpurt_result gpurt_photon_map_query(gpurt_photon_map map, const gpurt_photon_query_desc *desc)
{
  return guard([&] {
    const auto object = get(map, "map");
    const gpurt_photon_query_desc d = read_descriptor(desc);
    object->map->query(checked_query(d, object->map->facts(), *object->device));
  });
}

gpurt_result gpurt_cuda_query_photons(gpurt_photon_map map, const gpurt_photon_query_desc *desc, void *stream,
                                      void *wait_event, void *done_event)
{
  return guard([&] {
    const auto object = get(map, "map");
    const gpurt_photon_query_desc d = read_descriptor(desc);
    const PhotonQuery query = checked_query(d, object->map->facts(), *object->device);
    const auto *queries = dynamic_cast<const StreamQueries *>(object->map.get());
    if (!queries) {
      fail(GPURT_ERROR_UNSUPPORTED,
           "the map is on a CPU device, which has no streams; use gpurt_photon_map_query");
    }
    if (query.kind == PhotonQueryKind::List) {
      fail(GPURT_ERROR_UNSUPPORTED,
           "GPURT_PHOTON_QUERY_LIST does not work on streams: only the end of the work tells how many points "
           "are "
           "found; use gpurt_photon_map_query");
    }
    if (query.method != GatherMethod::Grid) {
      fail(GPURT_ERROR_UNSUPPORTED,
           "GPURT_GATHER_NODE_LISTS does not work on streams: its lists are made first; use "
           "gpurt_photon_map_query");
    }
    if (!query.device_memory) {
      fail_invalid(
          "work on a stream needs storage GPURT_STORAGE_DEVICE; host memory could change before it is read");
    }
    queries->query_on_stream(query, stream, wait_event, done_event);
  });
}
