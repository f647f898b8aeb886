// The CUDA device: its scenes, its memory, and the list of what is there.
#include <algorithm>
#include <chrono>
#include <mutex>
#include <optional>

#include "cuda/accel/choose_tree.h"
#include "cuda/accel/device_bvh_accel.h"
#include "cuda/accel/device_kd_accel.h"
#include "cuda/accel/query.h"
#include "cuda/accel/schedule/tracer.h"
#include "cuda/device_scene.h"
#include "cuda/factory.h"
#include "cuda/kernel_listing.h"
#include "cuda/path/device_film.h"
#include "cuda/path/render.h"
#include "cuda/photon/photon_map.h"
#include "cuda/photon/render.h"
#include "cuda/photon/scene_photons.h"
#include "cuda/probe.h"
#include "cuda/reyes/render.h"
#include "error.h"

namespace gpurt::cuda {
namespace {

// What kernels need: independent thread scheduling, and what NVIDIA's current compilers still compile for.
constexpr uint32_t min_compute_capability = 75;

// Trees of fewer triangles are built on the host: the device takes a few milliseconds for the smallest.
constexpr uint64_t max_host_bvh_triangles = 2048, max_host_kd_triangles = 2048;

// Of kd-trees for this device: finer than CPUs', since its warps test triangles with few of their lanes (docs/kdtree.md).
constexpr float device_traversal_cost = 1.0f;

// Films stay on the device while they take less than this part of its memory.
constexpr uint64_t films_share = 8;

// What scenes, frames and jobs of a device share; scenes and films keep it alive.
struct SharedDevice {
  DeviceInfo info;
  std::shared_ptr<DeviceMemory> memory;
  LanePool lanes;
  FilmBudget film_budget;
};

class CudaScene final : public CommittedScene, public StreamTracing {
 public:
  /// `copied` is what the device has of the scene already; null: it is copied here.
  CudaScene(std::shared_ptr<SharedDevice> device, std::shared_ptr<const CompiledScene> compiled,
            std::shared_ptr<const DeviceScene> copied, const KdTrees &trees, uint64_t most_host_triangles,
            const DeviceKdSettings &settings)
      : CudaScene(std::move(device), std::move(compiled), std::move(copied), trees.facts, kd_trees_, trees,
                  most_host_triangles, settings)
  {
    uint64_t built_bytes = 0;
    for (const DeviceKdTree &tree : kd_trees_->built()) {
      facts_.num_nodes += tree.num_nodes;
      facts_.num_references += tree.num_references;
      facts_.tree_depth = std::max(facts_.tree_depth, tree.depth);
      facts_.sah_cost += tree.sah_cost;
      facts_.build_seconds += tree.seconds;
      // What was built before stays.
      facts_.build_peak_bytes = std::max(facts_.build_peak_bytes, built_bytes + tree.peak_bytes);
      built_bytes += tree.nodes.bytes() + tree.references.bytes();
    }
    trace_scene_.kd_trees = kd_trees_->view();
    trace_scene_.kd_quads = kd_trees_->quads();
    trace_scene_.near_triangles = trace_scene_.kd_quads.triangles;
  }
  CudaScene(std::shared_ptr<SharedDevice> device, std::shared_ptr<const CompiledScene> compiled,
            const BvhTrees &trees, uint64_t most_host_triangles, const DeviceBvhAccel *previous)
      : CudaScene(std::move(device), std::move(compiled), nullptr, trees.facts, bvhs_, trees,
                  most_host_triangles, previous)
  {
    trace_scene_.bvhs = bvhs_->view();
    trace_scene_.has_bvhs = true;
    uint64_t built_bytes = 0;
    for (const DeviceBvh &tree : bvhs_->built()) {
      facts_.num_nodes += tree.nodes.size();
      facts_.num_references += tree.triangles.size();
      facts_.tree_depth = std::max(facts_.tree_depth, tree.depth);
      facts_.sah_cost += tree.sah_cost;
      facts_.build_seconds += tree.seconds;
      facts_.is_refitted |= tree.is_refitted;
      // What was built before stays.
      facts_.build_peak_bytes = std::max(facts_.build_peak_bytes, built_bytes + tree.peak_bytes);
      built_bytes += tree.nodes.bytes() + tree.triangles.bytes();
    }
    trace_scene_.world = bvhs_->world();
    trace_scene_.near_triangles = trace_scene_.world.triangles;
  }

  ~CudaScene() override
  {
    // Buffers go before the device; nothing runs on them, since every call waits for its work.
    kd_trees_.reset();
    bvhs_.reset();
    scene_.reset();
  }

  const AccelFacts &accel_facts() const override { return facts_; }
  /// Null for kd-trees.
  const DeviceBvhAccel *bvhs() const { return bvhs_ ? &*bvhs_ : nullptr; }
  const DeviceKdAccel *kd_trees() const { return kd_trees_ ? &*kd_trees_ : nullptr; }
  const TraceScene &trace_scene() const { return trace_scene_; }
  const std::shared_ptr<const DeviceScene> &device_scene() const { return scene_; }
  void set_reason(std::string reason) { facts_.reason = std::move(reason); }

  void trace(const TraceRequest &request) const override
  {
    const DeviceScope scope(device_->memory->ordinal());
    trace_batch({trace_scene_, device_->memory, device_->lanes, slices_}, request);
  }

  void trace_on_stream(const TraceRequest &request, void *stream, void *wait_event,
                       void *done_event) const override
  {
    const DeviceScope scope(device_->memory->ordinal());
    queue_batch({trace_scene_, device_->memory, device_->lanes, slices_}, request,
                static_cast<cudaStream_t>(stream), static_cast<cudaEvent_t>(wait_event),
                static_cast<cudaEvent_t>(done_event));
  }

  void render(const RenderPass &pass) const override
  {
    const DeviceScope scope(device_->memory->ordinal());
    if (pass.photon != nullptr) render_photons_on_device(pass, trace_scene_, device_->memory, device_->lanes);
    else if (pass.reyes != nullptr)
      render_reyes_on_device(pass, trace_scene_, reyes_scene(), device_->memory, device_->lanes);
    else render_on_device(pass, trace_scene_, device_->memory, device_->lanes);
  }

  std::unique_ptr<DeviceFilm> make_film(uint32_t width, uint32_t height, uint32_t outputs) const override
  {
    return std::make_unique<CudaFilm>(device_, device_->memory, device_->lanes, device_->film_budget, width,
                                      height, outputs);
  }

  void require_photons() const override {}
  void require_photon_statistics() const override {}
  uint64_t most_photon_passes() const override { return cuda::most_photon_passes; }
  PhotonPilot photon_pilot(const PathSettings &settings, const EmissionView &emission, uint32_t num_paths,
                           uint32_t points_per_axis, const TakePilotPhotons &take) const override
  {
    const DeviceScope scope(device_->memory->ordinal());
    return photon_pilot_on_device(settings, emission, num_paths, points_per_axis, take, trace_scene_,
                                  device_->memory, device_->lanes);
  }

  std::shared_ptr<const PhotonMap> photon_map(const PathSettings &settings, const EmissionView &emission,
                                              const ScenePhotonRequest &request) const override
  {
    const DeviceScope scope(device_->memory->ordinal());
    return photon_map_on_device(settings, emission, request, trace_scene_, device_, device_->memory,
                                device_->lanes);
  }

  void require_reyes() const override {}

  ReyesSchedule resolve_reyes_schedule(const Schedule &asked, const ReyesSettings &settings) const override
  {
    return cuda::resolve_reyes_schedule(asked, settings);
  }

  Schedule resolve_schedule(const Schedule &asked, ScheduleUse use) const override
  {
    return cuda::resolve_schedule(asked, use, trace_scene_);
  }

  HostKdTree export_tree(uint32_t tree) const override
  {
    if (!kd_trees_) refuse_bvh_export();
    const size_t group = group_of_tree(*compiled_, tree);
    const DeviceScope scope(device_->memory->ordinal());
    const LaneLease lane = device_->lanes.acquire();
    return kd_trees_->download(group, lane->stream());
  }

 private:
  template <class DeviceAccel, class Trees, class... Options>
  CudaScene(std::shared_ptr<SharedDevice> device, std::shared_ptr<const CompiledScene> compiled,
            std::shared_ptr<const DeviceScene> copied, const AccelFacts &facts,
            std::optional<DeviceAccel> &accel, const Trees &trees, Options... options)
      : device_(std::move(device)), compiled_(std::move(compiled)), facts_(facts), scene_(std::move(copied))
  {
    const DeviceScope scope(device_->memory->ordinal());
    const LaneLease lane = device_->lanes.acquire();
    if (!scene_) scene_ = std::make_shared<DeviceScene>(*compiled_, device_->memory, lane->stream());
    accel.emplace(*compiled_, scene_->view(), trees, options..., device_->memory, lane->stream());
    trace_scene_.slices = &slices_;
    trace_scene_.scene = scene_->view();
    trace_scene_.scene.t_error = t_error(facts_);
    trace_scene_.triangle_test = facts_.triangle_test;
    check(cudaDeviceGetAttribute(&trace_scene_.num_sms, cudaDevAttrMultiProcessorCount,
                                 device_->memory->ordinal()),
          "cudaDeviceGetAttribute");
    facts_.accel_bytes = accel->bytes();
    int cache_bytes = 0;
    check(cudaDeviceGetAttribute(&cache_bytes, cudaDevAttrL2CacheSize, device_->memory->ordinal()),
          "cudaDeviceGetAttribute");
    trace_scene_.is_cached = facts_.accel_bytes <= uint64_t(cache_bytes);
  }

  ReyesDeviceScene reyes_scene() const
  {
    ReyesDeviceScene reyes{};
    reyes.view = scene_->reyes_view();
    reyes.has_found_light = compiled_->environment.is_present != 0;
    reyes.view.scene = trace_scene_.scene;
    if (!compiled_->root_ranges.empty()) reyes.num_roots = compiled_->root_ranges.back().first_root;
    reyes.has_meshes = compiled_->has_meshes();
    for (const Segment &segment : compiled_->segments) {
      const Material &material = compiled_->materials[segment.material];
      reyes.has_blending |= material.blends != 0;
      reyes.has_opaque |= material.blends == 0;
      reyes.may_show_nothing |=
          material.blends != 0 && (material.base_color_texture != invalid_id || !(material.alpha > 0));
      reyes.has_cutouts |= material.blends == 0 && material.alpha_cutoff > 0;
    }
    for (const Light &light : compiled_->lights) reyes.has_found_light |= light.type == LightType::Triangle;
    return reyes;
  }

  std::shared_ptr<SharedDevice> device_;
  std::shared_ptr<const CompiledScene> compiled_;
  AccelFacts facts_;
  std::shared_ptr<const DeviceScene> scene_;
  // One of the two.
  std::optional<DeviceKdAccel> kd_trees_;
  std::optional<DeviceBvhAccel> bvhs_;
  TraceScene trace_scene_{};
  mutable SliceSize slices_;
};

class CudaBackend final : public Backend, public StreamOrdering, public KernelListing, public PhotonMaps {
 public:
  CudaBackend(const DeviceInfo &info, const BackendOptions &options)
      : device_(std::make_shared<SharedDevice>()), log_(options.log)
  {
    device_->info = info;
    device_->film_budget.most = info.memory_bytes / films_share;
    const DeviceScope scope(int(info.ordinal));
    device_->memory = std::make_shared<DeviceMemory>(int(info.ordinal), options.memory_limit_bytes);
  }

  const DeviceInfo &info() const override { return device_->info; }
  const std::shared_ptr<MemoryTracker> &memory() const override { return device_->memory->tracker(); }

  std::shared_ptr<const CommittedScene> commit(std::shared_ptr<const CompiledScene> scene,
                                               const BuildOptions &options) override
  {
    if (options.accel == Accel::Embree) {
      fail(GPURT_ERROR_UNSUPPORTED,
           "embree is an accelerator of the CPU; on a CUDA device use GPURT_ACCEL_BVH or GPURT_ACCEL_KDTREE");
    }
    switch (options.accel) {
      case Accel::Bvh:
        return commit_bvhs(scene, options);
      case Accel::KdTree:
        return commit_kd_trees(scene, options);
      default:
        return commit_either(scene, options);
    }
  }

  std::shared_ptr<const PhotonMap> make_photon_map(const PhotonMapRequest &request) override
  {
    const DeviceScope scope(device_->memory->ordinal());
    return std::make_shared<CudaPhotonMap>(request, device_, device_->memory, device_->lanes);
  }

  std::shared_ptr<void> allocate(uint64_t bytes) override
  {
    const DeviceScope scope(device_->memory->ordinal());
    auto buffer = std::make_shared<DeviceBuffer<std::byte>>(device_->memory, bytes, "a device buffer");
    if (bytes != 0) {
      const LaneLease lane = device_->lanes.acquire();
      check(cudaMemsetAsync(buffer->data(), 0, bytes, lane->stream()), "cudaMemsetAsync");
      lane->synchronize();
    }
    return std::shared_ptr<void>(buffer->data(), [memory = device_->memory, buffer](void *) {
      memory->wait_for_default_stream();  // the buffer goes with this function
    });
  }

  void copy_to_host(void *host, const void *device, uint64_t bytes) override
  {
    if (bytes == 0) return;
    const DeviceScope scope(device_->memory->ordinal());
    const LaneLease lane = device_->lanes.acquire();
    lane->wait_for_default_stream();
    check(cudaMemcpyAsync(host, device, bytes, cudaMemcpyDeviceToHost, lane->stream()), "cudaMemcpyAsync");
    lane->synchronize();
  }

  void copy_to_device(void *device, const void *host, uint64_t bytes) override
  {
    if (bytes == 0) return;
    const DeviceScope scope(device_->memory->ordinal());
    const LaneLease lane = device_->lanes.acquire();
    lane->wait_for_default_stream();
    check(cudaMemcpyAsync(device, host, bytes, cudaMemcpyHostToDevice, lane->stream()), "cudaMemcpyAsync");
    lane->synchronize();
  }

  bool holds(const void *data) const override
  {
    const DeviceScope scope(device_->memory->ordinal());
    cudaPointerAttributes attributes{};
    check(cudaPointerGetAttributes(&attributes, data), "cudaPointerGetAttributes");
    return attributes.type == cudaMemoryTypeDevice && attributes.device == device_->memory->ordinal();
  }

  void order_streams(uint32_t ordinal, void *stream, void *after) override
  {
    check_ordinal(ordinal);
    const DeviceScope scope(device_->memory->ordinal());
    Event passed(cudaEventDisableTiming);
    passed.record(static_cast<cudaStream_t>(after));
    check(cudaStreamWaitEvent(static_cast<cudaStream_t>(stream), passed.get(), 0), "cudaStreamWaitEvent");
  }

  void wait_for_stream(uint32_t ordinal, void *stream) override
  {
    check_ordinal(ordinal);
    const DeviceScope scope(device_->memory->ordinal());
    check(cudaStreamSynchronize(static_cast<cudaStream_t>(stream)), "cudaStreamSynchronize");
  }

  std::vector<KernelInfo> kernels() const override
  {
    const DeviceScope scope(device_->memory->ordinal());
    cudaDeviceProp properties{};
    check(cudaGetDeviceProperties(&properties, device_->memory->ordinal()), "cudaGetDeviceProperties");
    return list_kernels(properties);
  }

 private:
  void check_ordinal(uint32_t ordinal) const
  {
    if (ordinal != device_->info.ordinal)
      fail_invalid("ordinal is {}, but the device is CUDA device {}", ordinal, device_->info.ordinal);
  }

  // The tree that a probe expects to be faster: a kd-tree as GPURT_ACCEL_KDTREE has it, to the bit.
  std::shared_ptr<const CommittedScene> commit_either(const std::shared_ptr<const CompiledScene> &scene,
                                                      const BuildOptions &options)
  {
    const std::shared_ptr<CudaScene> bvh = commit_bvhs(scene, options);
    if (options.quality == BuildQuality::Fast) {
      bvh->set_reason("built in the least time, and refitted");
      return bvh;
    }
    TreeChoice choice;
    {
      const DeviceScope scope(device_->memory->ordinal());
      const LaneLease lane = device_->lanes.acquire();
      choice = choose_tree(*scene, bvh->trace_scene(), kd_settings(options), device_->memory, lane->stream());
    }
    bvh->set_reason(choice.reason);
    if (!choice.is_kd_tree) return bvh;
    try {
      const std::shared_ptr<CudaScene> kd_tree = commit_kd_trees(scene, options, bvh->device_scene());
      kd_tree->set_reason(choice.reason);
      return kd_tree;
    } catch (const Error &error) {
      if (error.result() != GPURT_ERROR_OUT_OF_MEMORY && error.result() != GPURT_ERROR_UNSUPPORTED) throw;
      bvh->set_reason(fmt::format("{}; but there was no room for it: {}", choice.reason, error.what()));
      return bvh;
    }
  }

  std::shared_ptr<CudaScene> commit_bvhs(const std::shared_ptr<const CompiledScene> &scene,
                                         const BuildOptions &options)
  {
    const uint64_t most_host_triangles =
        options.quality == BuildQuality::Fast ? max_host_bvh_triangles : UINT64_MAX;
    const auto start = std::chrono::steady_clock::now();
    BvhTrees trees = build_bvh_trees(*scene, options.triangle_test, nullptr, most_host_triangles);
    trees.facts.build_seconds = seconds_since(start);
    const auto *previous = dynamic_cast<const CudaScene *>(options.previous.get());
    const auto committed = std::make_shared<CudaScene>(device_, scene, trees, most_host_triangles,
                                                       previous != nullptr ? previous->bvhs() : nullptr);
    for (const DeviceBvh &tree : committed->bvhs()->built()) {
      if (!log_) break;
      log_(GPURT_LOG_INFO,
           tree.is_refitted
               ? fmt::format("a bvh of {} references was refitted in {:.2f} ms; its SAH cost is {:.3f} of "
                             "what it was built with",
                             tree.triangles.size(), tree.seconds * 1e3, tree.sah_cost / tree.built_sah_cost)
               : fmt::format("a bvh of {} references was built on the device in {:.2f} ms, of which "
                             "references {:.2f}, splits {:.2f}, layout {:.2f}; it held {} bytes",
                             tree.triangles.size(), tree.seconds * 1e3, tree.reference_seconds * 1e3,
                             tree.split_seconds * 1e3, tree.layout_seconds * 1e3, tree.peak_bytes));
    }
    return committed;
  }

  std::shared_ptr<CudaScene> commit_kd_trees(const std::shared_ptr<const CompiledScene> &scene,
                                             const BuildOptions &options,
                                             std::shared_ptr<const DeviceScene> copied = nullptr)
  {
    // Trees that come from elsewhere, or go to a cache, are the host's.
    const bool is_fast =
        options.quality == BuildQuality::Fast && options.imported.empty() && options.cache_path.empty();
    const uint64_t most_host_triangles = is_fast ? max_host_kd_triangles : UINT64_MAX;
    DeviceKdSettings settings = kd_settings(options);
    if (settings.traversal_cost == 0) settings.traversal_cost = device_traversal_cost;
    BuildOptions own = options;
    // As on every other device: what a cache holds, and where hits depend on the tree.
    if (options.cache_path.empty() && options.triangle_test != TriangleTest::MollerTrumbore)
      own.traversal_cost = settings.traversal_cost;
    const auto start = std::chrono::steady_clock::now();
    KdTrees trees = build_kd_trees(*scene, own, nullptr, log_, most_host_triangles);
    trees.facts.build_seconds = seconds_since(start);
    const auto committed =
        std::make_shared<CudaScene>(device_, scene, std::move(copied), trees, most_host_triangles, settings);
    for (const DeviceKdTree &tree : committed->kd_trees()->built()) {
      if (!log_) break;
      log_(GPURT_LOG_INFO,
           fmt::format("a kd-tree of {} references was built on the device in {:.2f} ms; it held {} bytes",
                       tree.num_references, tree.seconds * 1e3, tree.peak_bytes));
    }
    return committed;
  }

  static DeviceKdSettings kd_settings(const BuildOptions &options)
  {
    return {options.max_depth, options.traversal_cost, options.empty_bonus};
  }

  static double seconds_since(std::chrono::steady_clock::time_point start)
  {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  }

  std::shared_ptr<SharedDevice> device_;
  std::function<void(gpurt_log_level, const std::string &)> log_;
};

uint32_t compute_capability(const cudaDeviceProp &p) { return uint32_t(p.major * 10 + p.minor); }

std::vector<DeviceInfo> find_devices()
{
  std::vector<DeviceInfo> devices;
  int count = 0;
  if (cudaGetDeviceCount(&count) != cudaSuccess) {
    (void)cudaGetLastError();  // no driver, or no device: there is nothing to list
    return devices;
  }
  for (int i = 0; i < count; ++i) {
    cudaDeviceProp properties{};
    if (cudaGetDeviceProperties(&properties, i) != cudaSuccess) {
      (void)cudaGetLastError();
      continue;
    }
    DeviceInfo info;
    info.type = GPURT_DEVICE_CUDA;
    info.ordinal = uint32_t(i);
    info.num_threads = uint32_t(properties.multiProcessorCount);
    info.memory_bytes = properties.totalGlobalMem;
    info.compute_capability = compute_capability(properties);
    info.name = properties.name;
    info.instruction_set = fmt::format("sm_{}", info.compute_capability);
    devices.push_back(std::move(info));
  }
  return devices;
}

// A process has the devices that it began with; one that is lost can no longer be asked what it is.
std::vector<DeviceInfo> enumerate()
{
  static std::mutex mutex;
  static std::vector<DeviceInfo> known;
  const std::lock_guard lock(mutex);
  if (known.empty()) known = find_devices();
  return known;
}

std::unique_ptr<Backend> create(const BackendOptions &options)
{
  const std::vector<DeviceInfo> devices = enumerate();
  const DeviceInfo *info = nullptr;
  for (const DeviceInfo &d : devices) {
    if (d.ordinal == options.ordinal) info = &d;
  }
  if (info == nullptr) {
    if (devices.empty()) {
      fail(GPURT_ERROR_DEVICE,
           "there is no CUDA device: no driver was found or it shows none; check nvidia-smi and "
           "CUDA_VISIBLE_DEVICES, or use the CPU device");
    }
    fail(GPURT_ERROR_DEVICE, "there is no CUDA device {}; there are {}, counted from 0", options.ordinal,
         devices.size());
  }
  if (info->compute_capability < min_compute_capability) {
    fail(GPURT_ERROR_UNSUPPORTED,
         "{} has compute capability {}.{}, and gpurt needs {}.{} or newer; use the CPU device", info->name,
         info->compute_capability / 10, info->compute_capability % 10, min_compute_capability / 10,
         min_compute_capability % 10);
  }
  const DeviceScope scope(int(info->ordinal));
  if (!has_kernels_for_current_device()) {
    fail(GPURT_ERROR_UNSUPPORTED,
         "this build of gpurt has no kernels for {} (compute capability {}.{}); build it with "
         "-DCMAKE_CUDA_ARCHITECTURES={}",
         info->name, info->compute_capability / 10, info->compute_capability % 10, info->compute_capability);
  }
  return std::make_unique<CudaBackend>(*info, options);
}

}  // namespace

const BackendFactory &factory()
{
  static const BackendFactory cuda = {GPURT_DEVICE_CUDA, enumerate, create};
  return cuda;
}

}  // namespace gpurt::cuda
