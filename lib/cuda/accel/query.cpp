#include "cuda/accel/query.h"

#include <algorithm>
#include <cstring>

#include "error.h"

namespace gpurt::cuda {
namespace {

// Rays of a host batch that travel together: enough to fill the device, few enough that copies and kernels of
// different chunks overlap in batches of a few million.
constexpr uint64_t host_chunk_rays = uint64_t(1) << 18;
// Host threads that copy: one cannot read and write host memory as fast as the device answers.
constexpr unsigned max_host_lanes = 4;
// Memory for the hits of a chunk of an all-hits query, beyond which the chunk is answered in parts.
constexpr uint64_t all_hits_budget = uint64_t(1) << 21;

constexpr uint64_t min_slice_rays = uint64_t(1) << 10, max_slice_rays = uint64_t(1) << 22;

uint64_t hit_bytes(const TraceRequest &request)
{
  return request.compact ? sizeof(CompactHit) : sizeof(FullHit);
}

// Calls start(first, count), which launches a kernel over these rays, for slices of the batch, two of which are queued
// at a time so that the device does not wait for the host.
template <class Start>
void run_in_slices(Lane &lane, SliceSize &slice, uint64_t num_rays, Start &&start)
{
  uint64_t counts[2] = {0, 0};
  const auto finish = [&](int k) {
    if (counts[k] == 0) return;
    lane.timing[k].end.wait();
    slice.learn(counts[k], seconds_between(lane.timing[k].begin, lane.timing[k].end));
    counts[k] = 0;
  };
  int k = 0;
  for (uint64_t first = 0; first < num_rays; k ^= 1) {
    finish(k);
    counts[k] = std::min(slice.get(), num_rays - first);
    lane.timing[k].begin.record(lane.stream());
    start(first, counts[k]);
    lane.timing[k].end.record(lane.stream());
    first += counts[k];
  }
  finish(k);
  finish(k ^ 1);
}

void copy_async(void *to, const void *from, uint64_t bytes, cudaMemcpyKind kind, Lane &lane)
{
  if (bytes != 0) check(cudaMemcpyAsync(to, from, bytes, kind, lane.stream()), "cudaMemcpyAsync");
}

void check_device_pointer(const void *pointer, const char *name, int ordinal)
{
  if (pointer == nullptr) return;
  cudaPointerAttributes attributes{};
  check(cudaPointerGetAttributes(&attributes, pointer), "cudaPointerGetAttributes");
  if (attributes.type == cudaMemoryTypeUnregistered) {
    fail_invalid("{} is host memory, which the CUDA device cannot reach; set storage to GPURT_STORAGE_HOST",
                 name);
  }
  if (attributes.type == cudaMemoryTypeDevice && attributes.device != ordinal) {
    fail_invalid("{} lies on CUDA device {}, the scene on CUDA device {}; copy it there first", name,
                 attributes.device, ordinal);
  }
}

void check_device_pointers(const TraceRequest &request, int ordinal)
{
  check_device_pointer(request.rays, "rays", ordinal);
  check_device_pointer(request.hits, "hits", ordinal);
  check_device_pointer(request.occluded, "occluded", ordinal);
  check_device_pointer(request.offsets, "offsets", ordinal);
}

std::byte *results_of(const TraceRequest &request)
{
  return request.query == QueryKind::Any ? reinterpret_cast<std::byte *>(request.occluded)
                                         : static_cast<std::byte *>(request.hits);
}
uint64_t result_bytes_of(const TraceRequest &request)
{
  return request.query == QueryKind::Any ? 1 : hit_bytes(request);
}

void launch_hits(const QueryContext &context, const TraceRequest &request, const Ray *rays, uint64_t num_rays,
                 void *results, cudaStream_t stream)
{
  if (request.query == QueryKind::Any) {
    launch_any(context.scene, rays, num_rays, static_cast<uint8_t *>(results), stream);
  } else {
    launch_closest(context.scene, rays, num_rays, request.compact ? HitLayout::Compact : HitLayout::Full,
                   results, stream);
  }
}

// Closest and any hits: a result of the same size for every ray.
void trace_each_on_device(const QueryContext &context, const TraceRequest &request)
{
  const LaneLease lane = context.lanes.acquire();
  lane->wait_for_default_stream();
  const uint64_t result_bytes = result_bytes_of(request);
  std::byte *results = results_of(request);
  run_in_slices(*lane, context.slice, request.num_rays, [&](uint64_t first, uint64_t count) {
    launch_hits(context, request, request.rays + first, count, results + first * result_bytes,
                lane->stream());
  });
  lane->synchronize();
}

void trace_each_on_host(const QueryContext &context, const TraceRequest &request)
{
  const uint64_t result_bytes = result_bytes_of(request);
  std::byte *results = results_of(request);
  const uint64_t chunk_rays = std::min(host_chunk_rays, request.num_rays);
  const uint64_t num_chunks = (request.num_rays + chunk_rays - 1) / chunk_rays;
  std::atomic<uint64_t> next_chunk{0};
  run_on_lanes(
      context.lanes, context.memory->ordinal(), unsigned(std::min<uint64_t>(num_chunks, max_host_lanes)),
      [&](Lane &lane, const std::atomic<bool> &stop) {
        const DeviceBuffer<Ray> rays(context.memory, chunk_rays, "a chunk of rays");
        const DeviceBuffer<std::byte> hits(context.memory, chunk_rays * result_bytes, "a chunk of hits");
        const WaitAtEnd wait(lane.stream());
        void *pinned_rays = lane.to_device.reserve(rays.bytes());
        void *pinned_hits = lane.to_host.reserve(hits.bytes());
        for (uint64_t c; !stop && (c = next_chunk++) < num_chunks;) {
          const uint64_t first = c * chunk_rays, count = std::min(chunk_rays, request.num_rays - first);
          std::memcpy(pinned_rays, request.rays + first, count * sizeof(Ray));
          copy_async(rays.data(), pinned_rays, count * sizeof(Ray), cudaMemcpyHostToDevice, lane);
          run_in_slices(lane, context.slice, count, [&](uint64_t i, uint64_t n) {
            launch_hits(context, request, rays.data() + i, n, hits.data() + i * result_bytes, lane.stream());
          });
          copy_async(pinned_hits, hits.data(), count * result_bytes, cudaMemcpyDeviceToHost, lane);
          lane.synchronize();
          std::memcpy(results + first * result_bytes, pinned_hits, count * result_bytes);
        }
      });
}

// All hits, chunk after chunk: how many a chunk has decides where the next one's begin.
void trace_all(const QueryContext &context, const TraceRequest &request)
{
  const LaneLease lane = context.lanes.acquire();
  if (request.device_memory) lane->wait_for_default_stream();
  const uint64_t chunk_rays = std::min(host_chunk_rays, std::max<uint64_t>(request.num_rays, 1));
  const uint64_t hit_size = hit_bytes(request);
  const DeviceBuffer<Ray> ray_buffer(context.memory, request.device_memory ? 0 : chunk_rays,
                                     "a chunk of rays");
  const DeviceBuffer<uint64_t> offsets(context.memory, chunk_rays + 1, "offsets of a chunk of rays");
  const DeviceBuffer<std::byte> scratch(context.memory, scan_scratch_bytes(chunk_rays + 1),
                                        "a scan's working memory");
  DeviceBuffer<std::byte> hit_buffer;
  const WaitAtEnd wait(lane->stream());
  uint64_t *host_offsets =
      static_cast<uint64_t *>(lane->to_host.reserve((chunk_rays + 1) * sizeof(uint64_t)));
  const auto write_offsets = [&](uint64_t first, uint64_t count) {
    if (request.device_memory) {
      copy_async(request.offsets + first, offsets.data(), count * sizeof(uint64_t), cudaMemcpyDeviceToDevice,
                 *lane);
    } else {
      std::memcpy(request.offsets + first, host_offsets, count * sizeof(uint64_t));
    }
  };

  uint64_t num_hits = 0;
  for (uint64_t first = 0; first < request.num_rays; first += chunk_rays) {
    const uint64_t count = std::min(chunk_rays, request.num_rays - first);
    const Ray *rays = request.rays + first;
    if (!request.device_memory) {
      void *pinned = lane->to_device.reserve(chunk_rays * sizeof(Ray));
      std::memcpy(pinned, rays, count * sizeof(Ray));
      copy_async(ray_buffer.data(), pinned, count * sizeof(Ray), cudaMemcpyHostToDevice, *lane);
      rays = ray_buffer.data();
    }
    run_in_slices(*lane, context.slice, count, [&](uint64_t i, uint64_t n) {
      launch_count_all(context.scene, rays + i, n, offsets.data() + i, lane->stream());
    });
    // The sum before element `count`, whatever is in it, is the number of hits.
    check(cudaMemsetAsync(offsets.data() + count, 0, sizeof(uint64_t), lane->stream()), "cudaMemsetAsync");
    scan_counts(offsets.data(), count + 1, num_hits, offsets.data(), scratch.data(), scratch.size(),
                lane->stream());
    copy_async(host_offsets, offsets.data(), (count + 1) * sizeof(uint64_t), cudaMemcpyDeviceToHost, *lane);
    lane->synchronize();
    write_offsets(first, count + 1);
    num_hits = host_offsets[count];
    if (request.hits == nullptr || num_hits > request.hit_capacity) continue;

    // Parts of the chunk whose hits fit the budget, or single rays.
    for (uint64_t begin = 0; begin < count;) {
      uint64_t end = request.device_memory ? count : begin + 1;
      while (end < count && host_offsets[end + 1] - host_offsets[begin] <= all_hits_budget) ++end;
      const uint64_t part_first = host_offsets[begin], part_hits = host_offsets[end] - part_first;
      std::byte *target = static_cast<std::byte *>(request.hits) + part_first * hit_size;
      if (!request.device_memory && hit_buffer.size() < part_hits * hit_size) {
        hit_buffer = {};  // first gives the smaller one back
        hit_buffer =
            DeviceBuffer<std::byte>(context.memory, part_hits * hit_size, "all hits of a chunk of rays");
      }
      void *output = request.device_memory ? target : hit_buffer.data();
      run_in_slices(*lane, context.slice, end - begin, [&](uint64_t i, uint64_t n) {
        launch_fill_all(context.scene, rays + begin + i, n, offsets.data() + begin + i, part_first,
                        request.compact, output, lane->stream());
      });
      if (!request.device_memory)
        copy_async(target, output, part_hits * hit_size, cudaMemcpyDeviceToHost, *lane);
      lane->synchronize();
      begin = end;
    }
  }
  if (request.num_rays == 0) {
    host_offsets[0] = 0;
    copy_async(offsets.data(), host_offsets, sizeof(uint64_t), cudaMemcpyHostToDevice, *lane);
    write_offsets(0, 1);
  }
  lane->synchronize();
  if (request.hits != nullptr && num_hits > request.hit_capacity) {
    fail_invalid("the rays have {} hits, but hit_capacity is {}; make hits larger, offsets tell how large",
                 num_hits, request.hit_capacity);
  }
}

}  // namespace

void SliceSize::learn(uint64_t num_rays, double seconds)
{
  // Aim for 20 to 60 ms: launching costs nothing there, and four times as much would still be in time.
  const uint64_t current = get();
  if (seconds > 0.060) {
    const double fitting = double(num_rays) * 0.040 / seconds;
    num_rays_ = std::min(current, std::max(uint64_t(fitting), min_slice_rays));
  } else if (seconds < 0.020 && num_rays == current) {
    num_rays_ = std::min(current * 2, max_slice_rays);
  }
}

void trace_batch(const QueryContext &context, const TraceRequest &request)
{
  if (request.device_memory) check_device_pointers(request, context.memory->ordinal());
  if (request.query == QueryKind::All) trace_all(context, request);
  else if (request.num_rays == 0) return;
  else if (request.device_memory) trace_each_on_device(context, request);
  else trace_each_on_host(context, request);
}

void queue_batch(const QueryContext &context, const TraceRequest &request, cudaStream_t stream,
                 cudaEvent_t wait_event, cudaEvent_t done_event)
{
  if (request.query == QueryKind::All) {
    fail(GPURT_ERROR_UNSUPPORTED,
         "all hits cannot be queued on a stream: how many there are decides what to launch; use "
         "gpurt_scene_trace");
  }
  check_device_pointers(request, context.memory->ordinal());
  if (wait_event != nullptr) check(cudaStreamWaitEvent(stream, wait_event, 0), "cudaStreamWaitEvent");
  const uint64_t slice = context.slice.get(), result_bytes = result_bytes_of(request);
  for (uint64_t first = 0; first < request.num_rays; first += slice) {
    launch_hits(context, request, request.rays + first, std::min(slice, request.num_rays - first),
                results_of(request) + first * result_bytes, stream);
  }
  if (done_event != nullptr) check(cudaEventRecord(done_event, stream), "cudaEventRecord");
}

}  // namespace gpurt::cuda
