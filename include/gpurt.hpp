// gpurt for C++17: owning handles, exceptions, std::vector. Header only; everything goes through the C ABI of gpurt.h.
//
//   gpurt::Device device(GPURT_DEVICE_CPU);
//   gpurt::Scene scene = device.load("scene.glb");
//   scene.commit();
//   gpurt::Frame frame = scene.frame(640, 480);
//   frame.render(64);
//   std::vector<float> color = frame.read(GPURT_OUTPUT_COLOR);
//
// Objects are references: copying one retains, destruction releases. Those made without arguments are empty: they may be
// assigned and tested, and every other use of them throws. Failures throw gpurt::Error.
#ifndef GPURT_HPP
#define GPURT_HPP

#include <array>
#include <chrono>
#include <cstring>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "gpurt.h"

namespace gpurt {

/// A failed call: what() is the text of gpurt_last_error, result() the code.
class Error : public std::runtime_error {
 public:
  Error(gpurt_result result, const std::string &text) : std::runtime_error(text), result_(result) {}
  gpurt_result result() const noexcept { return result_; }

 private:
  gpurt_result result_;
};

/// Throws unless the call went well.
inline void check(gpurt_result result)
{
  if (result != GPURT_OK) throw Error(result, gpurt_last_error());
}

/// One reference to an object of the C ABI.
template <class H, gpurt_result (*Retain)(H), gpurt_result (*Release)(H)>
class Handle {
 public:
  Handle() = default;
  /// Takes over a reference that the caller owns.
  explicit Handle(H owned) noexcept : handle_(owned) {}
  Handle(const Handle &other) : handle_(other.handle_)
  {
    if (handle_) check(Retain(handle_));
  }
  Handle(Handle &&other) noexcept : handle_(std::exchange(other.handle_, nullptr)) {}
  Handle &operator=(Handle other) noexcept
  {
    std::swap(handle_, other.handle_);
    return *this;
  }
  ~Handle() { reset(); }

  void reset() noexcept
  {
    if (handle_) Release(std::exchange(handle_, nullptr));
  }
  /// The handle, for calls of the C ABI; still owned by this object.
  H get() const noexcept { return handle_; }
  /// Hands the reference over to the caller.
  H detach() noexcept { return std::exchange(handle_, nullptr); }
  explicit operator bool() const noexcept { return handle_ != nullptr; }

 private:
  H handle_ = nullptr;
};

class Buffer : public Handle<gpurt_buffer, gpurt_buffer_retain, gpurt_buffer_release> {
 public:
  using Handle::Handle;

  void *data() const { return place().first; }
  uint64_t size_bytes() const { return place().second; }
  /// Copies host memory into part of the buffer, or the other way round.
  void write(const void *data, uint64_t size_bytes, uint64_t offset_bytes = 0) const
  {
    check(gpurt_buffer_write(get(), offset_bytes, data, size_bytes));
  }
  void read(void *data, uint64_t size_bytes, uint64_t offset_bytes = 0) const
  {
    check(gpurt_buffer_read(get(), offset_bytes, data, size_bytes));
  }
  /// `count` elements of T in this buffer, for a descriptor that is used while this object lives.
  template <class T>
  gpurt_array array(uint64_t count, uint64_t offset_bytes = 0,
                    uint64_t stride_bytes = sizeof(T)) const noexcept
  {
    return {nullptr, get(), offset_bytes, stride_bytes, count};
  }

 private:
  std::pair<void *, uint64_t> place() const
  {
    std::pair<void *, uint64_t> p{};
    check(gpurt_buffer_get_data(get(), &p.first, &p.second));
    return p;
  }
};

/// The elements of a vector, std::array or the like as a gpurt_array; Element is the number of values to an element:
/// `array<3>(positions)` for a flat vector of floats. The container must outlive the call that reads it.
template <size_t Element = 1, class Container>
gpurt_array array(const Container &values)
{
  using T = std::remove_reference_t<decltype(*values.data())>;
  static_assert(std::is_trivially_copyable<std::remove_const_t<T>>::value, "arrays hold plain values");
  if (values.size() % Element != 0) {
    throw Error(GPURT_ERROR_INVALID_ARGUMENT, "an array has " + std::to_string(values.size()) +
                                                  " values, which is no multiple of " +
                                                  std::to_string(Element));
  }
  return {values.data(), nullptr, 0, Element * sizeof(T), values.size() / Element};
}

/// A job that runs. Its last reference cancels it: keep it until wait() has returned.
class Job : public Handle<gpurt_job, gpurt_job_retain, gpurt_job_release> {
 public:
  Job() = default;
  explicit Job(gpurt_job owned) noexcept : Handle(owned) {}

  /// Returns when the job has ended well; throws its error, or CANCELLED.
  void wait() const { check(gpurt_job_wait(get(), GPURT_WAIT_FOREVER)); }
  /// False if it still runs after that time.
  template <class Rep, class Period>
  bool wait_for(std::chrono::duration<Rep, Period> timeout) const
  {
    const auto ns = std::chrono::duration_cast<std::chrono::nanoseconds>(timeout).count();
    const gpurt_result result = gpurt_job_wait(get(), ns > 0 ? static_cast<uint64_t>(ns) : 0);
    if (result == GPURT_ERROR_TIMEOUT) return false;
    check(result);
    return true;
  }
  void cancel() const { check(gpurt_job_cancel(get())); }
  /// Share that is done, in [0, 1].
  double progress() const
  {
    double share = 0;
    check(gpurt_job_get_progress(get(), &share));
    return share;
  }
};

class Frame : public Handle<gpurt_frame, gpurt_frame_retain, gpurt_frame_release> {
 public:
  Frame() = default;
  explicit Frame(gpurt_frame owned) noexcept : Handle(owned) {}

  /// Starts rendering of tiles, or of the whole frame.
  Job submit(const gpurt_render_desc &desc, const std::vector<gpurt_tile> &tiles = {}) const
  {
    gpurt_job job = nullptr;
    check(gpurt_frame_submit(get(), &desc, tiles.empty() ? nullptr : tiles.data(), tiles.size(), &job));
    return Job(job);
  }
  Job submit(uint32_t samples_per_pixel) const
  {
    gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
    desc.samples_per_pixel = samples_per_pixel;
    return submit(desc);
  }
  /// Submits and waits.
  void render(const gpurt_render_desc &desc) const { submit(desc).wait(); }
  void render(uint32_t samples_per_pixel) const { submit(samples_per_pixel).wait(); }

  uint32_t width() const { return statistics().width; }
  uint32_t height() const { return statistics().height; }

  /// An output of floats, row by row, as many values to a pixel as gpurt_output states.
  std::vector<float> read(gpurt_output output) const { return read_as<float>(output); }
  /// An output of integers: primitive, instance or sample count.
  std::vector<uint32_t> read_ids(gpurt_output output) const { return read_as<uint32_t>(output); }

  void save(const std::string &path) const { check(gpurt_frame_save(get(), path.c_str())); }
  void load_state(const std::string &path) const { check(gpurt_frame_load_state(get(), path.c_str())); }
  void merge(const Frame &other) const { check(gpurt_frame_merge(get(), other.get())); }

  gpurt_statistics statistics() const
  {
    gpurt_statistics s = GPURT_STATISTICS_INIT;
    check(gpurt_frame_get_statistics(get(), &s));
    return s;
  }

 private:
  static size_t components(gpurt_output output)
  {
    switch (output) {
      case GPURT_OUTPUT_COLOR:
      case GPURT_OUTPUT_NORMAL:
      case GPURT_OUTPUT_ALBEDO:
      case GPURT_OUTPUT_POSITION:
      case GPURT_OUTPUT_VARIANCE:
      case GPURT_OUTPUT_BIAS:
      case GPURT_OUTPUT_ERROR:
        return 3;
      default:
        return 1;
    }
  }
  static bool is_integer(gpurt_output output)
  {
    return output == GPURT_OUTPUT_PRIMITIVE || output == GPURT_OUTPUT_INSTANCE ||
           output == GPURT_OUTPUT_SAMPLE_COUNT;
  }
  template <class T>
  std::vector<T> read_as(gpurt_output output) const
  {
    if (is_integer(output) != std::is_integral<T>::value) {
      throw Error(GPURT_ERROR_INVALID_ARGUMENT, is_integer(output) ? "the output holds integers; use read_ids"
                                                                   : "the output holds floats; use read");
    }
    const gpurt_statistics s = statistics();
    std::vector<T> values(static_cast<size_t>(s.width) * s.height * components(output));
    check(gpurt_frame_read(get(), output, values.data(), values.size() * sizeof(T)));
    return values;
  }
};

class PhotonMap;

class Scene : public Handle<gpurt_scene, gpurt_scene_retain, gpurt_scene_release> {
 public:
  Scene() = default;
  explicit Scene(gpurt_scene owned) noexcept : Handle(owned) {}

  uint32_t add(const gpurt_texture_desc &desc) const { return add_with(gpurt_scene_add_texture, desc); }
  uint32_t add(const gpurt_material_desc &desc) const { return add_with(gpurt_scene_add_material, desc); }
  uint32_t add(const gpurt_mesh_desc &desc) const { return add_with(gpurt_scene_add_mesh, desc); }
  uint32_t add(const gpurt_patches_desc &desc) const { return add_with(gpurt_scene_add_patches, desc); }
  uint32_t add(const gpurt_subdivision_desc &desc) const
  {
    return add_with(gpurt_scene_add_subdivision, desc);
  }
  uint32_t add(const gpurt_instance_desc &desc) const { return add_with(gpurt_scene_add_instance, desc); }
  uint32_t add(const gpurt_light_desc &desc) const { return add_with(gpurt_scene_add_light, desc); }
  uint32_t add(const gpurt_camera_desc &desc) const { return add_with(gpurt_scene_add_camera, desc); }
  void set_vertices(uint32_t geometry, const gpurt_array &vertices,
                    const gpurt_array *normals = nullptr) const
  {
    check(gpurt_scene_set_vertices(get(), geometry, &vertices, normals));
  }
  void set(const gpurt_environment_desc &desc) const { check(gpurt_scene_set_environment(get(), &desc)); }

  /// Adds a mesh from flat arrays of x y z and of corners, placed once where it is.
  uint32_t add_mesh(const std::vector<float> &positions, const std::vector<uint32_t> &indices,
                    uint32_t material = 0) const
  {
    gpurt_mesh_desc mesh = GPURT_MESH_DESC_INIT;
    mesh.material = material;
    mesh.vertices = array<3>(positions);
    mesh.indices = array<3>(indices);
    gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
    instance.geometry = add(mesh);
    add(instance);
    return instance.geometry;
  }

  gpurt_camera_desc camera(uint32_t id) const
  {
    gpurt_camera_desc desc = GPURT_CAMERA_DESC_INIT;
    check(gpurt_scene_get_camera(get(), id, &desc));
    return desc;
  }
  gpurt_scene_facts facts() const
  {
    gpurt_scene_facts f = GPURT_SCENE_FACTS_INIT;
    check(gpurt_scene_get_facts(get(), &f));
    return f;
  }

  void commit() const { check(gpurt_scene_commit(get(), nullptr)); }
  void commit(const gpurt_build_desc &desc) const { check(gpurt_scene_commit(get(), &desc)); }

  /// Closest hits, one a ray.
  std::vector<gpurt_hit> trace(const std::vector<gpurt_ray> &rays) const
  {
    std::vector<gpurt_hit> hits(rays.size());
    gpurt_trace_desc desc = trace_desc(rays, GPURT_QUERY_CLOSEST);
    desc.hits = hits.data();
    trace(desc);
    return hits;
  }
  /// 1 where a ray hits something.
  std::vector<uint8_t> occluded(const std::vector<gpurt_ray> &rays) const
  {
    std::vector<uint8_t> result(rays.size());
    gpurt_trace_desc desc = trace_desc(rays, GPURT_QUERY_ANY);
    desc.occluded = result.data();
    trace(desc);
    return result;
  }
  /// Every crossing: those of ray i are hits[offsets[i]] to hits[offsets[i + 1]].
  struct AllHits {
    std::vector<gpurt_hit> hits;
    std::vector<uint64_t> offsets;
  };
  AllHits trace_all(const std::vector<gpurt_ray> &rays) const
  {
    AllHits all;
    all.offsets.resize(rays.size() + 1);
    gpurt_trace_desc desc = trace_desc(rays, GPURT_QUERY_ALL);
    desc.offsets = all.offsets.data();
    trace(desc);  // counts
    all.hits.resize(all.offsets.back());
    if (!all.hits.empty()) {
      desc.hits = all.hits.data();
      desc.hit_capacity = all.hits.size();
      trace(desc);
    }
    return all;
  }
  void trace(const gpurt_trace_desc &desc) const { check(gpurt_scene_trace(get(), &desc)); }

  /// The patches that hits of the last commit lie on, and where on them; misses stay misses.
  std::vector<gpurt_patch_point> locate(const std::vector<gpurt_hit> &hits) const
  {
    std::vector<gpurt_patch_point> points(hits.size());
    gpurt_locate_desc desc = GPURT_LOCATE_DESC_INIT;
    desc.num_hits = hits.size();
    desc.hits = hits.data();
    desc.points = points.data();
    locate(desc);
    return points;
  }
  void locate(const gpurt_locate_desc &desc) const { check(gpurt_scene_locate(get(), &desc)); }

  /// Photons from the lights to a map on the scene's device: see gpurt_photon_map_trace.
  PhotonMap trace_photons(const gpurt_photon_trace_desc &desc) const;
  PhotonMap trace_photons(uint32_t num_paths = 0, uint64_t seed = 0) const;

  Frame frame(const gpurt_frame_desc &desc) const
  {
    gpurt_frame f = nullptr;
    check(gpurt_frame_create(get(), &desc, &f));
    return Frame(f);
  }
  /// Size 0: what the camera says.
  Frame frame(uint32_t width = 0, uint32_t height = 0, uint32_t outputs = 0) const
  {
    gpurt_frame_desc desc = GPURT_FRAME_DESC_INIT;
    desc.width = width;
    desc.height = height;
    desc.outputs = outputs;
    return frame(desc);
  }

  struct KdTree {
    uint32_t tree = 0;
    uint64_t num_triangles = 0;
    std::array<float, 3> bounds_min{}, bounds_max{};
    std::vector<gpurt_kdtree_node> nodes;
    std::vector<uint32_t> references;
  };
  KdTree export_tree(uint32_t tree = 0) const
  {
    gpurt_kdtree desc = GPURT_KDTREE_INIT;
    desc.tree = tree;
    check(gpurt_scene_export_tree(get(), &desc));
    KdTree result;
    result.nodes.resize(desc.num_nodes);
    result.references.resize(desc.num_references);
    desc.nodes = result.nodes.data();
    desc.references = result.references.data();
    check(gpurt_scene_export_tree(get(), &desc));
    result.tree = tree;
    result.num_triangles = desc.num_triangles;
    std::memcpy(result.bounds_min.data(), desc.bounds_min, sizeof desc.bounds_min);
    std::memcpy(result.bounds_max.data(), desc.bounds_max, sizeof desc.bounds_max);
    return result;
  }
  void import_tree(const KdTree &tree) const
  {
    gpurt_kdtree desc = GPURT_KDTREE_INIT;
    desc.tree = tree.tree;
    desc.num_triangles = tree.num_triangles;
    std::memcpy(desc.bounds_min, tree.bounds_min.data(), sizeof desc.bounds_min);
    std::memcpy(desc.bounds_max, tree.bounds_max.data(), sizeof desc.bounds_max);
    desc.num_nodes = tree.nodes.size();
    desc.num_references = tree.references.size();
    // The library only reads them: the struct serves import and export.
    desc.nodes = const_cast<gpurt_kdtree_node *>(tree.nodes.data());
    desc.references = const_cast<uint32_t *>(tree.references.data());
    check(gpurt_scene_import_tree(get(), &desc));
  }

 private:
  template <class Desc>
  uint32_t add_with(gpurt_result (*add)(gpurt_scene, const Desc *, uint32_t *), const Desc &desc) const
  {
    uint32_t id = GPURT_INVALID_ID;
    check(add(get(), &desc, &id));
    return id;
  }
  static gpurt_trace_desc trace_desc(const std::vector<gpurt_ray> &rays, gpurt_query query)
  {
    gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
    desc.query = query;
    desc.num_rays = rays.size();
    desc.rays = rays.data();
    return desc;
  }
};

/// Points in space that are found by their places: see "Photon maps" in gpurt.h. Places are flat arrays of x y z.
class PhotonMap : public Handle<gpurt_photon_map, gpurt_photon_map_retain, gpurt_photon_map_release> {
 public:
  PhotonMap() = default;
  explicit PhotonMap(gpurt_photon_map owned) noexcept : Handle(owned) {}

  gpurt_photon_map_info info() const
  {
    gpurt_photon_map_info i = GPURT_PHOTON_MAP_INFO_INIT;
    check(gpurt_photon_map_get_info(get(), &i));
    return i;
  }
  void save(const std::string &path) const { check(gpurt_photon_map_save(get(), path.c_str())); }
  /// What the map keeps of its points, three values a point.
  std::vector<float> read(gpurt_photon_attribute attribute) const
  {
    std::vector<float> values(3 * info().num_points);
    check(gpurt_photon_map_read(get(), attribute, values.data(), values.size() * sizeof(float)));
    return values;
  }

  /// How many points are within the radius of each place.
  std::vector<uint32_t> count(const std::vector<float> &places, float radius) const
  {
    gpurt_photon_query_desc desc = query_desc(places, GPURT_PHOTON_QUERY_COUNT, radius);
    std::vector<uint32_t> counts(desc.num_queries);
    desc.counts = counts.data();
    query(desc);
    return counts;
  }
  /// The weighed sums of their fluxes, three values a place.
  std::vector<float> sum(const std::vector<float> &places, float radius,
                         gpurt_gather_kernel kernel = GPURT_GATHER_KERNEL_CONSTANT) const
  {
    gpurt_photon_query_desc desc = query_desc(places, GPURT_PHOTON_QUERY_SUM, radius);
    desc.kernel = kernel;
    std::vector<float> sums(places.size());
    desc.sums = sums.data();
    query(desc);
    return sums;
  }
  /// Which they are: those of place i are ids[offsets[i]] to ids[offsets[i + 1]].
  struct Lists {
    std::vector<uint64_t> offsets;
    std::vector<uint32_t> ids;
    std::vector<float> distances;
  };
  Lists list(const std::vector<float> &places, float radius) const
  {
    gpurt_photon_query_desc desc = query_desc(places, GPURT_PHOTON_QUERY_LIST, radius);
    Lists lists;
    lists.offsets.resize(desc.num_queries + 1);
    desc.offsets = lists.offsets.data();
    query(desc);  // counts
    desc.capacity = lists.offsets.back();
    lists.ids.resize(desc.capacity);
    lists.distances.resize(desc.capacity);
    if (desc.capacity != 0) {
      desc.ids = lists.ids.data();
      desc.distances = lists.distances.data();
      query(desc);
    }
    return lists;
  }
  /// The k nearest to each place, sorted: counts[i] of ids[i * k] and what follows; the rest is GPURT_INVALID_ID.
  struct Nearest {
    std::vector<uint32_t> counts, ids;
    std::vector<float> distances;
  };
  /// Radius 0: however far away.
  Nearest nearest(const std::vector<float> &places, uint32_t k, float radius = 0) const
  {
    gpurt_photon_query_desc desc = query_desc(places, GPURT_PHOTON_QUERY_NEAREST, radius);
    Nearest found;
    found.counts.resize(desc.num_queries);
    found.ids.resize(desc.num_queries * k);
    found.distances.resize(desc.num_queries * k);
    desc.k = k;
    desc.counts = found.counts.data();
    desc.ids = found.ids.data();
    desc.distances = found.distances.data();
    query(desc);
    return found;
  }
  void query(const gpurt_photon_query_desc &desc) const { check(gpurt_photon_map_query(get(), &desc)); }

 private:
  static gpurt_photon_query_desc query_desc(const std::vector<float> &places, gpurt_photon_query query,
                                            float radius)
  {
    if (places.size() % 3 != 0) {
      throw Error(GPURT_ERROR_INVALID_ARGUMENT,
                  "places have " + std::to_string(places.size()) + " values, which is no multiple of 3");
    }
    gpurt_photon_query_desc desc = GPURT_PHOTON_QUERY_DESC_INIT;
    desc.query = query;
    desc.num_queries = places.size() / 3;
    desc.positions = places.data();
    desc.radius = radius;
    return desc;
  }
};

inline PhotonMap Scene::trace_photons(const gpurt_photon_trace_desc &desc) const
{
  gpurt_photon_map m = nullptr;
  check(gpurt_photon_map_trace(get(), &desc, &m));
  return PhotonMap(m);
}
inline PhotonMap Scene::trace_photons(uint32_t num_paths, uint64_t seed) const
{
  gpurt_photon_trace_desc desc = GPURT_PHOTON_TRACE_DESC_INIT;
  desc.num_paths = num_paths;
  desc.seed = seed;
  return trace_photons(desc);
}

class Device : public Handle<gpurt_device, gpurt_device_retain, gpurt_device_release> {
 public:
  Device() = default;
  explicit Device(gpurt_device owned) noexcept : Handle(owned) {}
  explicit Device(const gpurt_device_desc &desc) : Handle(create(desc)) {}
  explicit Device(gpurt_device_type type, uint32_t ordinal = 0) : Handle(create(type, ordinal)) {}
  /// Several CUDA devices that work as one.
  Device(gpurt_device_type type, const std::vector<uint32_t> &ordinals) : Handle(create(type, ordinals)) {}

  /// The CPU first, then CUDA devices by ordinal.
  static std::vector<gpurt_device_properties> enumerate()
  {
    uint32_t count = 0;
    check(gpurt_device_enumerate(nullptr, 0, &count));
    gpurt_device_properties unset = GPURT_DEVICE_PROPERTIES_INIT;
    std::vector<gpurt_device_properties> devices(count, unset);
    check(gpurt_device_enumerate(devices.data(), count, &count));
    if (count < devices.size()) devices.resize(count);
    return devices;
  }

  gpurt_device_properties properties() const
  {
    gpurt_device_properties p = GPURT_DEVICE_PROPERTIES_INIT;
    check(gpurt_device_get_properties(get(), &p));
    return p;
  }

  Scene scene() const
  {
    gpurt_scene s = nullptr;
    check(gpurt_scene_create(get(), &s));
    return Scene(s);
  }
  /// From a glTF file; commit it next.
  Scene load(const std::string &path) const
  {
    gpurt_scene s = nullptr;
    check(gpurt_scene_load(get(), path.c_str(), &s));
    return Scene(s);
  }

  PhotonMap photon_map(const gpurt_photon_map_desc &desc) const
  {
    gpurt_photon_map m = nullptr;
    check(gpurt_photon_map_create(get(), &desc, &m));
    return PhotonMap(m);
  }
  /// From flat arrays of x y z, and of red green blue or nothing.
  PhotonMap photon_map(const std::vector<float> &positions, const std::vector<float> &fluxes = {},
                       float radius = 0) const
  {
    if (positions.size() % 3 != 0 || (!fluxes.empty() && fluxes.size() != positions.size())) {
      throw Error(GPURT_ERROR_INVALID_ARGUMENT,
                  "positions and fluxes have " + std::to_string(positions.size()) + " and " +
                      std::to_string(fluxes.size()) + " values, not three a point");
    }
    gpurt_photon_map_desc desc = GPURT_PHOTON_MAP_DESC_INIT;
    desc.num_points = positions.size() / 3;
    desc.positions = positions.data();
    desc.fluxes = fluxes.empty() ? nullptr : fluxes.data();
    desc.radius = radius;
    return photon_map(desc);
  }
  PhotonMap load_photon_map(const std::string &path) const
  {
    gpurt_photon_map m = nullptr;
    check(gpurt_photon_map_load(get(), path.c_str(), &m));
    return PhotonMap(m);
  }

  Buffer buffer(const gpurt_buffer_desc &desc) const
  {
    gpurt_buffer b = nullptr;
    check(gpurt_buffer_create(get(), &desc, &b));
    return Buffer(b);
  }
  /// Memory of gpurt, filled with zeros.
  Buffer buffer(uint64_t size_bytes, gpurt_storage storage = GPURT_STORAGE_HOST) const
  {
    gpurt_buffer_desc desc = GPURT_BUFFER_DESC_INIT;
    desc.size_bytes = size_bytes;
    desc.storage = storage;
    return buffer(desc);
  }
  /// Shares a vector without a copy: the buffer takes it over and frees it when nothing reads it any more.
  template <class T>
  Buffer buffer(std::vector<T> values) const
  {
    static_assert(std::is_trivially_copyable<T>::value, "buffers hold plain values");
    auto owned = std::make_unique<std::vector<T>>(std::move(values));
    gpurt_buffer_desc desc = GPURT_BUFFER_DESC_INIT;
    desc.size_bytes = owned->size() * sizeof(T);
    desc.data = owned->data();
    desc.release = [](void *user, void *) { delete static_cast<std::vector<T> *>(user); };
    desc.release_user = owned.get();
    Buffer b = buffer(desc);  // where it throws, the vector is still ours
    owned.release();
    return b;
  }

 private:
  static gpurt_device create(const gpurt_device_desc &desc)
  {
    gpurt_device d = nullptr;
    check(gpurt_device_create(&desc, &d));
    return d;
  }
  static gpurt_device create(gpurt_device_type type, uint32_t ordinal)
  {
    gpurt_device_desc desc = GPURT_DEVICE_DESC_INIT;
    desc.type = type;
    desc.ordinal = ordinal;
    return create(desc);
  }
  static gpurt_device create(gpurt_device_type type, const std::vector<uint32_t> &ordinals)
  {
    gpurt_device_desc desc = GPURT_DEVICE_DESC_INIT;
    desc.type = type;
    desc.ordinals = ordinals.data();
    desc.num_ordinals = static_cast<uint32_t>(ordinals.size());
    return create(desc);
  }
};

}  // namespace gpurt
#endif
