#include "cuda/photon/query.h"

#include <algorithm>
#include <cstring>

#include "error.h"
#include "memory.h"

namespace gpurt::cuda {
namespace {

// Queries that are sorted and answered together: enough to fill the device, few enough to be done soon.
constexpr uint64_t slice_queries = uint64_t(1) << 22;
// Of a batch in host memory, for which there is room on the way.
constexpr uint64_t host_slice_queries = uint64_t(1) << 20;
// Ids of lists, in host memory, that are written at a time.
constexpr uint64_t host_slice_ids = uint64_t(1) << 22;
// Fewer queries than this are not worth sorting.
constexpr uint64_t min_sorted_queries = 4096;

// Queries of a slice in device memory, and where their answers go.
PhotonQuery part_of(const PhotonQuery &query, uint64_t begin, uint64_t n)
{
  PhotonQuery part = query;
  part.num_queries = n;
  part.positions += begin;
  if (part.normals != nullptr) part.normals += begin;
  if (part.counts != nullptr) part.counts += begin;
  if (part.sums != nullptr) part.sums += begin;
  if (part.offsets != nullptr) part.offsets += begin;
  if (part.ids != nullptr && part.kind == PhotonQueryKind::Nearest) part.ids += begin * part.k;
  if (part.distances != nullptr && part.kind == PhotonQueryKind::Nearest) part.distances += begin * part.k;
  return part;
}

bool is_sorted_first(const PhotonQuery &query, uint64_t n)
{
  return !query.is_coherent && n >= min_sorted_queries;
}

DeviceGather gather_of(const PhotonQuery &part, const uint32_t *order)
{
  DeviceGather gather{};
  gather.range = part.range;
  gather.positions = part.positions;
  gather.normals = part.normals;
  gather.order = order;
  gather.num_queries = uint32_t(part.num_queries);
  gather.counts = part.counts;
  gather.sums = part.sums;
  return gather;
}

ListGather list_gather_of(const PhotonQueryContext &context, const DeviceGather &gather)
{
  return {context.grid, *context.lists, gather.range,        gather.positions, gather.normals,  gather.counts,
          gather.sums,  gather.offsets, gather.first_listed, gather.ids,       gather.distances};
}

// Queues counts, sums or nearest points of a slice.
void launch_part(const PhotonQueryContext &context, const PhotonQuery &part, const uint32_t *order,
                 cudaStream_t stream)
{
  if (part.num_queries == 0) return;
  if (context.lists != nullptr)
    return launch_gather_lists(list_gather_of(context, gather_of(part, nullptr)), part.num_queries, stream);
  switch (part.kind) {
    case PhotonQueryKind::Sum:
      return launch_sum(context.grid, gather_of(part, order), stream);
    case PhotonQueryKind::Nearest:
      return launch_nearest(context.levels,
                            {part.positions, order, uint32_t(part.num_queries), part.k, part.limit, part.hint,
                             part.counts, part.ids, part.distances},
                            stream);
    default:
      return launch_count(context.grid, gather_of(part, order), stream);
  }
}

const GridShape &order_shape(const PhotonQueryContext &context, const PhotonQuery &query)
{
  return query.kind == PhotonQueryKind::Nearest ? context.levels.grids[0].shape : context.grid.shape;
}

// Memory to sort slices in.
class OrderMemory {
 public:
  OrderMemory(const PhotonQueryContext &context, const PhotonQuery &query, uint64_t slice)
      : shape_(order_shape(context, query)),
        memory_(context.memory, is_sorted_first(query, slice) ? query_order_bytes(slice) : 0,
                "sorting queries")
  {}
  const uint32_t *order(const PhotonQuery &part, cudaStream_t stream) const
  {
    if (!is_sorted_first(part, part.num_queries)) return nullptr;
    return launch_query_order(shape_, part.positions, uint32_t(part.num_queries), memory_.data(),
                              memory_.bytes(), stream);
  }

 private:
  const GridShape &shape_;
  DeviceBuffer<std::byte> memory_;
};

// Lists of a slice: counted, placed, and written where there is room.
class Lists {
 public:
  Lists(const PhotonQueryContext &context, const PhotonQuery &query, uint64_t slice)
      : context_(context),
        order_memory_(context, query, slice),
        counts_(context.memory, slice, "lists of photons"),
        offsets_memory_(context.memory, offsets_bytes(uint32_t(slice)), "lists of photons")
  {}

  // Writes the part's offsets, of which the first is `first`, to device memory.
  void count(const PhotonQuery &part, uint64_t first, uint64_t *offsets, cudaStream_t stream)
  {
    order_ = order_memory_.order(part, stream);
    DeviceGather gather = gather_of(part, order_);
    gather.counts = counts_.data();
    if (part.num_queries != 0) {
      if (context_.lists != nullptr)
        launch_gather_lists(list_gather_of(context_, gather), part.num_queries, stream);
      else launch_count(context_.grid, gather, stream);
    }
    launch_offsets(counts_.data(), uint32_t(part.num_queries), first, offsets, offsets_memory_.data(),
                   offsets_memory_.bytes(), stream);
  }
  // Of queries that were counted, all of them (in their order) or some.
  void list(const PhotonQuery &part, bool is_all, const uint64_t *offsets, uint64_t first_listed,
            uint32_t *ids, float *distances, cudaStream_t stream)
  {
    if (part.num_queries == 0) return;
    DeviceGather gather = gather_of(part, is_all ? order_ : nullptr);
    gather.counts = nullptr;
    gather.offsets = offsets;
    gather.first_listed = first_listed;
    gather.ids = ids;
    gather.distances = distances;
    if (context_.lists != nullptr)
      launch_gather_lists(list_gather_of(context_, gather), part.num_queries, stream);
    else launch_list(context_.grid, gather, stream);
  }

 private:
  const PhotonQueryContext &context_;
  const OrderMemory order_memory_;
  DeviceBuffer<uint32_t> counts_;
  DeviceBuffer<std::byte> offsets_memory_;
  const uint32_t *order_ = nullptr;
};

bool wants_lists(const PhotonQuery &query) { return query.ids != nullptr || query.distances != nullptr; }

template <class T>
T read_value(const T *device, cudaStream_t stream)
{
  T value;
  check(cudaMemcpyAsync(&value, device, sizeof value, cudaMemcpyDeviceToHost, stream), "cudaMemcpyAsync");
  check(cudaStreamSynchronize(stream), "cudaStreamSynchronize");
  return value;
}

void list_device_memory(const PhotonQueryContext &context, const PhotonQuery &query, Lane &lane)
{
  const uint64_t slice = std::min(slice_queries, query.num_queries);
  Lists lists(context, query, slice);
  const WaitAtEnd wait(lane.stream());
  uint64_t total = 0;
  for (uint64_t begin = 0; begin == 0 || begin < query.num_queries; begin += slice_queries) {
    const PhotonQuery part = part_of(query, begin, std::min(slice_queries, query.num_queries - begin));
    lists.count(part, total, part.offsets, lane.stream());
    total = read_value(part.offsets + part.num_queries, lane.stream());
    if (wants_lists(query) && total <= query.capacity)
      lists.list(part, true, part.offsets, 0, query.ids, query.distances, lane.stream());
  }
  lane.synchronize();
  check_capacity(query, total);
}

// Device memory for a slice of a batch in host memory, and the way there and back.
class HostSlices {
 public:
  HostSlices(const PhotonQueryContext &context, const PhotonQuery &query, Lane &lane)
      : query_(query), lane_(lane), slice_(std::min(host_slice_queries, query.num_queries))
  {
    const bool is_nearest = query.kind == PhotonQueryKind::Nearest;
    if (is_nearest)
      slice_ = std::max<uint64_t>(std::min(slice_, host_slice_ids / query.k), std::min<uint64_t>(slice_, 1));
    const auto make = [&]<class T>(DeviceBuffer<T> &buffer, const void *wanted, uint64_t count) {
      if (wanted != nullptr) buffer = {context.memory, count, "a slice of queries"};
    };
    make(positions_, query.positions, slice_);
    make(normals_, query.normals, slice_);
    make(counts_, query.counts, slice_);
    make(sums_, query.sums, slice_);
    if (is_nearest) {
      make(ids_, query.ids, slice_ * query.k);
      make(distances_, query.distances, slice_ * query.k);
    }
  }

  uint64_t slice() const { return slice_; }

  // Copies queries there, through pinned memory.
  PhotonQuery upload(uint64_t begin, uint64_t n)
  {
    const uint64_t bytes = n * sizeof(Vec3f);
    auto *const pinned = static_cast<std::byte *>(lane_.to_device.reserve(2 * slice_ * sizeof(Vec3f)));
    const auto copy = [&](DeviceBuffer<Vec3f> &to, const Vec3f *from, std::byte *by) {
      if (from == nullptr || n == 0) return;
      std::memcpy(by, from + begin, bytes);
      check(cudaMemcpyAsync(to.data(), by, bytes, cudaMemcpyHostToDevice, lane_.stream()), "cudaMemcpyAsync");
    };
    copy(positions_, query_.positions, pinned);
    copy(normals_, query_.normals, pinned + slice_ * sizeof(Vec3f));
    PhotonQuery part = query_;
    part.num_queries = n;
    part.positions = positions_.data();
    part.normals = normals_.data();
    part.counts = counts_.data();
    part.sums = sums_.data();
    part.offsets = nullptr;
    part.ids = ids_.data();
    part.distances = distances_.data();
    return part;
  }

  // Copies the answers back and waits.
  void download(uint64_t begin, uint64_t n)
  {
    const auto copy = [&](auto *to, const auto &from, uint64_t each) {
      if (to == nullptr || n == 0) return;
      download_values(to + begin * each, from.data(), n * each);
    };
    copy(query_.counts, counts_, 1);
    copy(query_.sums, sums_, 1);
    if (query_.kind != PhotonQueryKind::Nearest) return;
    copy(query_.ids, ids_, query_.k);
    copy(query_.distances, distances_, query_.k);
  }
  template <class T>
  void download_values(T *to, const T *from, uint64_t count)
  {
    void *const pinned = lane_.to_host.reserve(count * sizeof(T));
    check(cudaMemcpyAsync(pinned, from, count * sizeof(T), cudaMemcpyDeviceToHost, lane_.stream()),
          "cudaMemcpyAsync");
    lane_.synchronize();
    std::memcpy(to, pinned, count * sizeof(T));
  }

 private:
  const PhotonQuery &query_;
  Lane &lane_;
  uint64_t slice_;
  DeviceBuffer<Vec3f> positions_, normals_, sums_;
  DeviceBuffer<uint32_t> counts_, ids_;
  DeviceBuffer<float> distances_;
};

void list_host_memory(const PhotonQueryContext &context, const PhotonQuery &query, Lane &lane)
{
  HostSlices slices(context, query, lane);
  Lists lists(context, query, slices.slice());
  DeviceBuffer<uint64_t> offsets(context.memory, slices.slice() + 1, "lists of photons");
  DeviceBuffer<uint32_t> ids;
  DeviceBuffer<float> distances;
  const WaitAtEnd wait(lane.stream());
  query.offsets[0] = 0;
  uint64_t total = 0;
  for (uint64_t begin = 0; begin < query.num_queries; begin += slices.slice()) {
    const uint64_t n = std::min(slices.slice(), query.num_queries - begin);
    const PhotonQuery part = slices.upload(begin, n);
    lists.count(part, total, offsets.data(), lane.stream());
    uint64_t *const placed = query.offsets + begin;
    slices.download_values(placed, offsets.data(), n + 1);
    total = placed[n];
    if (!wants_lists(query) || total > query.capacity) continue;
    // As many queries at a time as there is room for their lists, or one.
    for (uint64_t i = 0, end; i < n; i = end) {
      end = i + 1;
      while (end < n && placed[end + 1] - placed[i] <= host_slice_ids) ++end;
      const uint64_t num_ids = placed[end] - placed[i];
      if (num_ids == 0) continue;
      lane.synchronize();
      const auto grow = [&]<class T>(DeviceBuffer<T> &buffer, const T *wanted) {
        if (wanted == nullptr || buffer.size() >= num_ids) return;
        buffer = {};
        buffer = {context.memory,
                  std::min(std::max(num_ids, host_slice_ids / 16), std::max(num_ids, host_slice_ids)),
                  "lists of photons"};
      };
      grow(ids, query.ids);
      grow(distances, query.distances);
      PhotonQuery few = part;
      few.num_queries = end - i;
      few.positions += i;
      if (few.normals != nullptr) few.normals += i;
      lists.list(few, end - i == n, offsets.data() + i, placed[i], ids.data(), distances.data(),
                 lane.stream());
      if (query.ids != nullptr) slices.download_values(query.ids + placed[i], ids.data(), num_ids);
      if (query.distances != nullptr)
        slices.download_values(query.distances + placed[i], distances.data(), num_ids);
    }
  }
  lane.synchronize();
  check_capacity(query, total);
}

}  // namespace

void query_device_memory(const PhotonQueryContext &context, const PhotonQuery &query, Lane &lane)
{
  lane.wait_for_default_stream();
  if (query.kind == PhotonQueryKind::List) return list_device_memory(context, query, lane);
  const OrderMemory memory(context, query, std::min(slice_queries, query.num_queries));
  const WaitAtEnd wait(lane.stream());
  for (uint64_t begin = 0; begin < query.num_queries; begin += slice_queries) {
    const PhotonQuery part = part_of(query, begin, std::min(slice_queries, query.num_queries - begin));
    launch_part(context, part, memory.order(part, lane.stream()), lane.stream());
  }
  lane.synchronize();
}

void query_host_memory(const PhotonQueryContext &context, const PhotonQuery &query, Lane &lane)
{
  if (query.kind == PhotonQueryKind::List) return list_host_memory(context, query, lane);
  HostSlices slices(context, query, lane);
  const OrderMemory memory(context, query, slices.slice());
  const WaitAtEnd wait(lane.stream());
  for (uint64_t begin = 0; begin < query.num_queries; begin += slices.slice()) {
    const uint64_t n = std::min(slices.slice(), query.num_queries - begin);
    const PhotonQuery part = slices.upload(begin, n);
    launch_part(context, part, memory.order(part, lane.stream()), lane.stream());
    slices.download(begin, n);
  }
}

void queue_query(const PhotonQueryContext &context, const PhotonQuery &query, cudaStream_t stream)
{
  const uint64_t slice = std::min(slice_queries, query.num_queries);
  const uint64_t bytes = is_sorted_first(query, slice) ? query_order_bytes(slice) : 0;
  // Where there is no memory to sort in, queries are answered as they are.
  const StreamWords memory(*context.memory, stream, bytes / sizeof(uint32_t));
  for (uint64_t begin = 0; begin < query.num_queries; begin += slice_queries) {
    const PhotonQuery part = part_of(query, begin, std::min(slice_queries, query.num_queries - begin));
    const bool is_sorted = is_sorted_first(part, part.num_queries);
    launch_part(context, part,
                is_sorted ? launch_query_order(order_shape(context, query), part.positions,
                                               uint32_t(part.num_queries), memory.data(), bytes, stream)
                          : nullptr,
                stream);
  }
}

}  // namespace gpurt::cuda
