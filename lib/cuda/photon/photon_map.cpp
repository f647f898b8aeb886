#include "cuda/photon/photon_map.h"

#include <algorithm>
#include <span>

#include "accel/node_lists.h"
#include "cuda/photon/query.h"

namespace gpurt::cuda {
namespace {

// What a map is made from, in device memory: the caller's, or a copy of it.
class DevicePoints {
 public:
  DevicePoints(const PhotonMapRequest &request, const std::shared_ptr<DeviceMemory> &memory, Lane &lane)
      : source_(request.source)
  {
    const uint64_t n = source_.num_photons;
    if (request.device_memory) {
      check_device_pointer(source_.positions, "positions", memory->ordinal(), "the map");
      check_device_pointer(source_.fluxes, "fluxes", memory->ordinal(), "the map");
      check_device_pointer(source_.normals, "normals", memory->ordinal(), "the map");
      lane.wait_for_default_stream();
      return;
    }
    const auto copy = [&]<class T>(DeviceBuffer<T> &to, const T *&from) {
      if (from == nullptr) return;
      to = upload(memory, std::span<const T>(from, n), "a map's points", lane.stream());
      from = to.data();
    };
    copy(records_, source_.records);
    copy(positions_, source_.positions);
    copy(fluxes_, source_.fluxes);
    copy(normals_, source_.normals);
  }
  const PhotonSource &source() const { return source_; }

 private:
  PhotonSource source_;
  DeviceBuffer<Photon> records_;
  DeviceBuffer<Vec3f> positions_, fluxes_, normals_;
};

template <class T>
T read_value(const DeviceBuffer<T> &buffer, Lane &lane)
{
  T value;
  check(cudaMemcpyAsync(&value, buffer.data(), sizeof value, cudaMemcpyDeviceToHost, lane.stream()),
        "cudaMemcpyAsync");
  lane.synchronize();
  return value;
}

PointsFound read_found(const DeviceBuffer<DevicePointsFound> &buffer, Lane &lane)
{
  const DevicePointsFound found = read_value(buffer, lane);
  const auto index = [](uint32_t i) { return i == invalid_id ? UINT64_MAX : uint64_t(i); };
  return {bounds_of(found.bounds), index(found.bad_position), index(found.bad_flux), index(found.bad_normal)};
}

}  // namespace

CudaPhotonMap::CudaPhotonMap(const PhotonMapRequest &request, std::shared_ptr<void> owner,
                             std::shared_ptr<DeviceMemory> memory, LanePool &lanes)
    : owner_(std::move(owner)), memory_(std::move(memory)), lanes_(lanes)
{
  const LaneLease lane = lanes_.acquire();
  build(request, *lane);
}

CudaPhotonMap::~CudaPhotonMap()
{
  // Every other call has waited for its work.
  if (was_queued_) {
    try {
      const DeviceScope scope(memory_->ordinal());
      ignore(cudaDeviceSynchronize());
    } catch (const Error &) {
      // A failed device fails the next call.
    }
  }
  grids_.clear();
}

void CudaPhotonMap::build(const PhotonMapRequest &request, Lane &lane)
{
  const DevicePoints points(request, memory_, lane);
  const PhotonSource &source = points.source();
  // Payload in arrays of its own is packed into records first: a random read then touches one sector, not three.
  const bool packs = source.records == nullptr && (request.has_fluxes || request.has_normals);
  const DeviceBuffer<Photon> packed(memory_, packs ? source.num_photons : 0, "sorting photons");
  const DeviceBuffer<DevicePointsFound> found_buffer(memory_, 1, "a map's bounds");
  const DeviceBuffer<DeviceFill> fill_buffer(memory_, 1, "a map's bounds");
  Event begin, end;
  // Whatever happens, kernels end before the buffers go.
  const WaitAtEnd wait(lane.stream());
  begin.record(lane.stream());
  launch_look_through(source, found_buffer.data(), packed.data(), lane.stream());
  end.record(lane.stream());
  const PointsFound found = read_found(found_buffer, lane);
  double seconds = seconds_between(begin, end);
  check_points(found);
  facts_ = facts_of(request, found.bounds);

  const auto fill_of = [&](const DevicePhotonGrid &grid) {
    launch_fill(grid.view().starts, grid.view().shape.table_size, fill_buffer.data(), lane.stream());
    return read_value(fill_buffer, lane);
  };
  // Queues the builds, and waits for them.
  const auto build_all = [&](const std::vector<DevicePhotonGrid> &grids, const PhotonSource &with_payload) {
    uint64_t bytes = 0;
    for (const DevicePhotonGrid &grid : grids) bytes = std::max(bytes, grid.build_bytes());
    const DeviceBuffer<std::byte> working(memory_, bytes, "sorting photons");
    const WaitAtEnd wait_for_builds(lane.stream());
    begin.record(lane.stream());
    // The first of a map's grids alone has payload.
    for (const DevicePhotonGrid &grid : grids)
      grid.build(&grid == grids.data() ? with_payload : source, working.data(), lane.stream());
    end.record(lane.stream());
    lane.synchronize();
    seconds += seconds_between(begin, end);
  };
  if (request.radius == 0) {
    facts_.radius = choose_radius(found.bounds, source.num_photons, [&](float radius) {
      std::vector<DevicePhotonGrid> grid;
      grid.emplace_back(make_grid_shape(found.bounds, radius, source.num_photons), source.num_photons,
                        DevicePhotonGridOptions{false, false, true}, memory_);
      build_all(grid, source);
      return double(fill_of(grid[0]).sum_of_squares) / double(source.num_photons);
    });
  }
  float radius = facts_.radius;
  for (uint32_t level = 0; level < request.num_levels; ++level, radius *= float(level_ratio)) {
    const bool keeps_flux = level == 0 && request.has_fluxes;
    const DevicePhotonGridOptions options = {level == 0 && request.has_normals, keeps_flux, !keeps_flux};
    grids_.emplace_back(make_grid_shape(found.bounds, radius, source.num_photons), source.num_photons,
                        options, memory_);
    levels_.grids[level] = grids_.back().view();
    facts_.bytes += grids_.back().bytes();
  }
  PhotonSource with_payload = source;
  if (packs) with_payload.records = packed.data();
  build_all(grids_, with_payload);
  levels_.num = request.num_levels;
  levels_.bounds = found.bounds;
  facts_.fullest_cell = fill_of(grids_[0]).fullest;
  facts_.build_seconds = seconds;
}

const PhotonGrid &CudaPhotonMap::grid_for(const PhotonQuery &query) const
{
  if (query.kind == PhotonQueryKind::Nearest) return levels_.grids[0];
  // Fluxes and normals are the finest level's alone.
  const bool needs_payload = query.kind == PhotonQueryKind::Sum || query.normals != nullptr;
  return levels_.grids[needs_payload ? 0 : level_for(levels_, query.range.radius)];
}

void CudaPhotonMap::query(const PhotonQuery &query) const
{
  const DeviceScope scope(memory_->ordinal());
  const LaneLease lane = lanes_.acquire();
  std::shared_ptr<const DeviceNodeLists> lists;  // kept until the query is done
  NodeLists view{};
  if (query.method == GatherMethod::NodeLists) {
    lists = lists_for(query.range.radius, *lane);
    view = lists->view();
  }
  const PhotonQueryContext context = {levels_, lists ? levels_.grids[0] : grid_for(query),
                                      lists ? &view : nullptr, memory_};
  if (!query.device_memory) return query_host_memory(context, query, *lane);
  check_device_pointers(query);
  query_device_memory(context, query, *lane);
}

std::shared_ptr<const DeviceNodeLists> CudaPhotonMap::lists_for(float radius, Lane &lane) const
{
  const std::lock_guard lock(lists_mutex_);
  if (lists_ && lists_->radius == radius) return lists_;
  lists_.reset();
  // Built on the host, whose memory is not the device's to limit.
  std::vector<PhotonProbe> probes(facts_.num_points);
  const WaitAtEnd wait(lane.stream());
  if (!probes.empty())
    check(cudaMemcpyAsync(probes.data(), levels_.grids[0].probes, probes.size() * sizeof(PhotonProbe),
                          cudaMemcpyDeviceToHost, lane.stream()),
          "cudaMemcpyAsync");
  lane.synchronize();
  const HostNodeLists host = build_node_lists(probes.data(), probes.size(), radius, nullptr);
  lists_ = std::make_shared<DeviceNodeLists>(DeviceNodeLists{
      radius, upload(memory_, std::span<const PhotonNode>(host.nodes), "lists of photons", lane.stream()),
      upload(memory_, std::span<const uint32_t>(host.photons), "lists of photons", lane.stream())});
  return lists_;
}

void CudaPhotonMap::query_on_stream(const PhotonQuery &query, void *stream, void *wait_event,
                                    void *done_event) const
{
  const DeviceScope scope(memory_->ordinal());
  check_device_pointers(query);
  const auto on = static_cast<cudaStream_t>(stream);
  if (wait_event != nullptr)
    check(cudaStreamWaitEvent(on, static_cast<cudaEvent_t>(wait_event), 0), "cudaStreamWaitEvent");
  was_queued_ = true;
  queue_query({levels_, grid_for(query), nullptr, memory_}, query, on);
  if (done_event != nullptr)
    check(cudaEventRecord(static_cast<cudaEvent_t>(done_event), on), "cudaEventRecord");
}

void CudaPhotonMap::check_device_pointers(const PhotonQuery &query) const
{
  const auto check_one = [&](const void *pointer, const char *name) {
    check_device_pointer(pointer, name, memory_->ordinal(), "the map");
  };
  check_one(query.positions, "positions");
  check_one(query.normals, "normals");
  check_one(query.counts, "counts");
  check_one(query.sums, "sums");
  check_one(query.offsets, "offsets");
  check_one(query.ids, "ids");
  check_one(query.distances, "distances");
}

void CudaPhotonMap::read(Photon *records) const
{
  if (facts_.num_points == 0) return;
  const DeviceScope scope(memory_->ordinal());
  const LaneLease lane = lanes_.acquire();
  const DeviceBuffer<Photon> buffer(memory_, facts_.num_points, "a copy of the points");
  const WaitAtEnd wait(lane->stream());
  launch_read_grid(levels_.grids[0], facts_.has_fluxes, buffer.data(), lane->stream());
  check(cudaMemcpyAsync(records, buffer.data(), buffer.bytes(), cudaMemcpyDeviceToHost, lane->stream()),
        "cudaMemcpyAsync");
  lane->synchronize();
}

}  // namespace gpurt::cuda
