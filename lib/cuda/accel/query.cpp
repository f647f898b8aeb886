#include "cuda/accel/query.h"

#include <algorithm>
#include <cstring>
#include <optional>

#include "cuda/accel/counting/kernels.h"
#include "cuda/accel/counting/lane_counter.h"
#include "cuda/accel/schedule/tracer.h"
#include "error.h"

namespace gpurt::cuda {
namespace {

// Rays of a host batch that travel together: enough to fill the device, few enough that copies and kernels of
// different chunks overlap in batches of a few million.
constexpr uint64_t host_chunk_rays = uint64_t(1) << 18;
// Host threads that copy: one cannot read and write host memory as fast as the device answers.
constexpr unsigned max_host_lanes = 4;
// One lane with larger chunks where the device's time is asked for: lanes that share the device would tell their waiting
// for one another as well.
constexpr uint64_t timed_chunk_rays = uint64_t(1) << 20;
// Crossings that an all-hits query lists at a time, beyond which a chunk is answered in parts.
constexpr uint64_t all_hits_budget = uint64_t(1) << 21;

uint64_t hit_bytes(const TraceRequest &request)
{
  return request.compact ? sizeof(CompactHit) : sizeof(FullHit);
}

// Rays of a launch: whole tiles of an image's rows, where the rays are an image's.
uint64_t slice_of(const TraceRequest &request, uint64_t num_rays)
{
  const uint64_t band = uint64_t(request.image_width) * 4;
  return band == 0 || num_rays < band ? num_rays : num_rays / band * band;
}

// Calls start(first, count), which launches a kernel over these rays, for slices of the batch, two of which are queued
// at a time so that the device does not wait for the host. Returns the seconds that they took on the device.
template <class Start>
double run_in_slices(Lane &lane, SliceSize &slice, const TraceRequest &request, uint64_t num_rays,
                     Start &&start)
{
  uint64_t counts[2] = {0, 0};
  double sum = 0;
  const auto finish = [&](int k) {
    if (counts[k] == 0) return;
    lane.timing[k].end.wait();
    const double seconds = seconds_between(lane.timing[k].begin, lane.timing[k].end);
    slice.learn(counts[k], seconds);
    sum += seconds;
    counts[k] = 0;
  };
  int k = 0;
  for (uint64_t first = 0; first < num_rays; k ^= 1) {
    finish(k);
    counts[k] = std::min(slice_of(request, slice.get()), num_rays - first);
    lane.timing[k].begin.record(lane.stream());
    start(first, counts[k]);
    lane.timing[k].end.record(lane.stream());
    first += counts[k];
  }
  finish(k);
  finish(k ^ 1);
  return sum;
}

void copy_async(void *to, const void *from, uint64_t bytes, cudaMemcpyKind kind, Lane &lane)
{
  if (bytes != 0) check(cudaMemcpyAsync(to, from, bytes, kind, lane.stream()), "cudaMemcpyAsync");
}

void check_device_pointers(const TraceRequest &request, int ordinal)
{
  check_device_pointer(request.rays, "rays", ordinal, "the scene");
  check_device_pointer(request.hits, "hits", ordinal, "the scene");
  check_device_pointer(request.occluded, "occluded", ordinal, "the scene");
  check_device_pointer(request.offsets, "offsets", ordinal, "the scene");
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

// Launches what the request's schedule says; `tracer` is null where it is the fused kernels, which use `scratch`.
void launch_hits(const QueryContext &context, const TraceRequest &request, ScheduledTracer *tracer,
                 const Ray *rays, uint64_t num_rays, void *results, uint32_t *scratch, cudaStream_t stream)
{
  if (tracer != nullptr) {
    const HitLayout layout = request.compact ? HitLayout::Compact : HitLayout::Full;
    if (request.query == QueryKind::Any)
      tracer->any(context.scene, rays, num_rays, static_cast<uint8_t *>(results));
    else tracer->closest(context.scene, rays, num_rays, layout, results);
    return;
  }
  // A thread a ray, where that was asked for, is what coherent rays take.
  const Coherence coherence =
      request.schedule.launch == Launch::Regular ? Coherence::Coherent : cuda::Coherence(request.coherence);
  const RayOrder order{coherence, request.image_width, scratch};
  if (request.query == QueryKind::Any) {
    launch_any(context.scene, rays, num_rays, static_cast<uint8_t *>(results), order, stream);
  } else {
    const auto launch = request.count_lanes ? counting::launch_closest : launch_closest;
    launch(context.scene, rays, num_rays, request.compact ? HitLayout::Compact : HitLayout::Full, results,
           order, stream);
  }
}

// The tracer of a lane, if the request's schedule needs one.
std::optional<ScheduledTracer> make_tracer(const QueryContext &context, const TraceRequest &request,
                                           uint64_t max_rays, cudaStream_t stream)
{
  if (is_fused(request.schedule)) return std::nullopt;
  return std::optional<ScheduledTracer>(std::in_place, request.schedule, context.memory, max_rays, stream,
                                        request.count_lanes);
}

// Adds what a lane did to the request's counters, once its work is done.
void count(const TraceRequest &request, std::optional<ScheduledTracer> &tracer, double seconds,
           std::mutex &mutex)
{
  if (request.counters == nullptr) return;
  ScheduleCounters counters;
  if (tracer) tracer->collect(counters);
  counters.device_ns = uint64_t(seconds * 1e9);
  const std::lock_guard lock(mutex);
  request.counters->add(counters);
}

// Closest and any hits: a result of the same size for every ray.
void trace_each_on_device(const QueryContext &context, const TraceRequest &request)
{
  const LaneLease lane = context.lanes.acquire();
  lane->wait_for_default_stream();
  const uint64_t result_bytes = result_bytes_of(request);
  std::byte *results = results_of(request);
  std::optional<ScheduledTracer> tracer = make_tracer(context, request, request.num_rays, lane->stream());
  const StreamWords scratch(*context.memory, lane->stream(),
                            trace_scratch_words(std::min(request.num_rays, max_slice_rays)));
  const WaitAtEnd wait(lane->stream());
  const double seconds =
      run_in_slices(*lane, context.slice, request, request.num_rays, [&](uint64_t first, uint64_t n) {
        launch_hits(context, request, tracer ? &*tracer : nullptr, request.rays + first, n,
                    results + first * result_bytes, scratch.data(), lane->stream());
      });
  lane->synchronize();
  std::mutex mutex;
  count(request, tracer, seconds, mutex);
}

// Rays and results of a part of a host batch, on their way through the device.
struct HostPart {
  uint64_t num_rays;  // at most
  DeviceBuffer<Ray> rays;
  DeviceBuffer<std::byte> results;
};

// What the lanes of a host batch share while they take memory.
class HostParts {
 public:
  HostParts(const QueryContext &context, uint64_t result_bytes)
      : context_(context), result_bytes_(result_bytes)
  {}

  // A part of `num_rays` rays; for the first lane of as many as memory has room for, for a later one none at all if
  // that is fewer: it leaves the work to the first.
  std::optional<HostPart> make(uint64_t num_rays)
  {
    const std::lock_guard lock(mutex_);
    for (;;) {
      try {
        HostPart part{num_rays,
                      {context_.memory, num_rays, "a chunk of rays"},
                      {context_.memory, num_rays * result_bytes_, "a chunk of hits"}};
        ++num_parts_;
        return part;
      } catch (const Error &e) {
        if (e.result() != GPURT_ERROR_OUT_OF_MEMORY) throw;
        if (num_parts_ != 0) return std::nullopt;
        if (num_rays <= min_slice_rays) throw;
        num_rays = std::max(num_rays / 2, min_slice_rays);
      }
    }
  }

 private:
  const QueryContext &context_;
  const uint64_t result_bytes_;
  std::mutex mutex_;
  unsigned num_parts_ = 0;
};

void trace_each_on_host(const QueryContext &context, const TraceRequest &request)
{
  const uint64_t result_bytes = result_bytes_of(request);
  std::byte *results = results_of(request);
  const bool is_timed = request.counters != nullptr;
  const uint64_t chunk_rays = std::min(is_timed ? timed_chunk_rays : host_chunk_rays, request.num_rays);
  const uint64_t num_chunks = (request.num_rays + chunk_rays - 1) / chunk_rays;
  std::atomic<uint64_t> next_chunk{0};
  HostParts parts(context, result_bytes);
  std::mutex counting;
  // Returns the seconds that the device took.
  const auto trace_part = [&](Lane &lane, const HostPart &part, ScheduledTracer *tracer, uint64_t first,
                              uint64_t count) {
    void *pinned_rays = lane.to_device.reserve(part.rays.bytes());
    void *pinned_results = lane.to_host.reserve(part.results.bytes());
    std::memcpy(pinned_rays, request.rays + first, count * sizeof(Ray));
    copy_async(part.rays.data(), pinned_rays, count * sizeof(Ray), cudaMemcpyHostToDevice, lane);
    const StreamWords scratch(*context.memory, lane.stream(), trace_scratch_words(count));
    const double seconds = run_in_slices(lane, context.slice, request, count, [&](uint64_t i, uint64_t n) {
      launch_hits(context, request, tracer, part.rays.data() + i, n, part.results.data() + i * result_bytes,
                  scratch.data(), lane.stream());
    });
    copy_async(pinned_results, part.results.data(), count * result_bytes, cudaMemcpyDeviceToHost, lane);
    lane.synchronize();
    std::memcpy(results + first * result_bytes, pinned_results, count * result_bytes);
    return seconds;
  };
  run_on_lanes(context.lanes, context.memory->ordinal(),
               unsigned(std::min<uint64_t>(num_chunks, is_timed ? 1 : max_host_lanes)),
               [&](Lane &lane, const std::atomic<bool> &stop) {
                 const std::optional<HostPart> part = parts.make(chunk_rays);
                 if (!part) return;
                 std::optional<ScheduledTracer> tracer =
                     make_tracer(context, request, part->num_rays, lane.stream());
                 const WaitAtEnd wait(lane.stream());
                 double seconds = 0;
                 for (uint64_t c; !stop && (c = next_chunk++) < num_chunks;) {
                   const uint64_t end = std::min((c + 1) * chunk_rays, request.num_rays);
                   for (uint64_t first = c * chunk_rays; first < end && !stop; first += part->num_rays)
                     seconds += trace_part(lane, *part, tracer ? &*tracer : nullptr, first,
                                           std::min(part->num_rays, end - first));
                 }
                 count(request, tracer, seconds, counting);
               });
}

// Kernels that count are as few as show what schedules do: closest hits by one triangle test.
void trace_counting(const QueryContext &context, const TraceRequest &request)
{
  if (context.scene.triangle_test != TriangleTest::Watertight) {
    fail(GPURT_ERROR_UNSUPPORTED,
         "count_lanes is set, but lanes are counted with GPURT_TRIANGLE_WATERTIGHT alone; commit with it, or "
         "set count_lanes to 0");
  }
  LaneCounter counter;
  {
    const LaneLease lane = context.lanes.acquire();
    counter.clear(lane->stream());
  }
  (request.device_memory ? trace_each_on_device : trace_each_on_host)(context, request);
  const LaneLease lane = context.lanes.acquire();
  counter.collect(*request.counters, lane->stream());
}

// All hits, chunk after chunk and part after part: how many a part has decides where the next one's begin.
class AllHitsQuery {
 public:
  AllHitsQuery(const QueryContext &context, const TraceRequest &request, Lane &lane)
      : context_(context),
        request_(request),
        lane_(lane),
        chunk_rays_(std::min(host_chunk_rays, std::max<uint64_t>(request.num_rays, 1))),
        rays_(context.memory, request.device_memory ? 0 : chunk_rays_, "a chunk of rays"),
        listed_offsets_(context.memory, chunk_rays_ + 1, "offsets of a chunk of rays"),
        hit_offsets_(context.memory, chunk_rays_ + 1, "offsets of a chunk of rays"),
        scratch_(context.memory, scan_scratch_bytes(chunk_rays_ + 1), "a scan's working memory"),
        wait_(lane.stream())
  {
    host_listed_ = static_cast<uint64_t *>(lane.to_host.reserve(2 * (chunk_rays_ + 1) * sizeof(uint64_t)));
    host_offsets_ = host_listed_ + chunk_rays_ + 1;
  }

  void run()
  {
    if (request_.device_memory) lane_.wait_for_default_stream();
    if (request_.num_rays == 0) {
      check(cudaMemsetAsync(hit_offsets_.data(), 0, sizeof(uint64_t), lane_.stream()), "cudaMemsetAsync");
      host_offsets_[0] = 0;
      write_offsets(0, 0);
    }
    for (uint64_t first = 0; first < request_.num_rays; first += chunk_rays_) {
      const uint64_t count = std::min(chunk_rays_, request_.num_rays - first);
      const Ray *rays = on_device(request_.rays + first, count);
      count_listed(rays, count);
      // Parts whose crossings fit the budget, or single rays.
      for (uint64_t begin = 0, end; begin < count; begin = end) {
        end = begin + 1;
        while (end < count && host_listed_[end + 1] - host_listed_[begin] <= all_hits_budget) ++end;
        trace_part(first, begin, end, rays);
      }
    }
    lane_.synchronize();
    if (request_.hits != nullptr && num_hits_ > request_.hit_capacity) {
      fail_invalid("the rays have {} hits, but hit_capacity is {}; make hits larger, offsets tell how large",
                   num_hits_, request_.hit_capacity);
    }
  }

 private:
  const Ray *on_device(const Ray *rays, uint64_t count)
  {
    if (request_.device_memory) return rays;
    void *pinned = lane_.to_device.reserve(rays_.bytes());
    std::memcpy(pinned, rays, count * sizeof(Ray));
    copy_async(rays_.data(), pinned, count * sizeof(Ray), cudaMemcpyHostToDevice, lane_);
    return rays_.data();
  }

  // Where the crossings of each ray of the chunk would be listed, on the device and the host.
  void count_listed(const Ray *rays, uint64_t count)
  {
    run_in_slices(lane_, context_.slice, request_, count, [&](uint64_t i, uint64_t n) {
      launch_count_all(context_.scene, rays + i, n, listed_offsets_.data() + i, lane_.stream());
    });
    sum_counts(listed_offsets_, count, 0, host_listed_);
  }

  // Rays begin .. end - 1 of the chunk that begins at `first`.
  void trace_part(uint64_t first, uint64_t begin, uint64_t end, const Ray *rays)
  {
    const uint64_t first_listed = host_listed_[begin], count = end - begin;
    const uint64_t *listed_offsets = listed_offsets_.data() + begin;
    grow(listed_, host_listed_[end] - first_listed, "all hits of a chunk of rays");
    run_in_slices(lane_, context_.slice, request_, count, [&](uint64_t i, uint64_t n) {
      launch_list_all(context_.scene, rays + begin + i, n, listed_offsets + i, first_listed, listed_.data(),
                      hit_offsets_.data() + i, lane_.stream());
    });
    const uint64_t first_hit = num_hits_;
    sum_counts(hit_offsets_, count, first_hit, host_offsets_);
    num_hits_ = host_offsets_[count];
    write_offsets(first + begin, count);
    if (request_.hits == nullptr || num_hits_ > request_.hit_capacity) return;

    const uint64_t bytes = (num_hits_ - first_hit) * hit_bytes(request_);
    std::byte *target = static_cast<std::byte *>(request_.hits) + first_hit * hit_bytes(request_);
    if (!request_.device_memory) grow(results_, bytes, "all hits of a chunk of rays");
    std::byte *output = request_.device_memory ? target : results_.data();
    launch_write_all(context_.scene.scene, count, listed_offsets, first_listed, listed_.data(),
                     hit_offsets_.data(), first_hit, request_.compact, output, lane_.stream());
    if (!request_.device_memory) copy_async(target, output, bytes, cudaMemcpyDeviceToHost, lane_);
    lane_.synchronize();
  }

  // Turns counts into sums from `base` on, `count` + 1 of them, and brings them to the host.
  void sum_counts(const DeviceBuffer<uint64_t> &counts, uint64_t count, uint64_t base, uint64_t *host)
  {
    // The sum before element `count`, whatever is in it, is that of all.
    check(cudaMemsetAsync(counts.data() + count, 0, sizeof(uint64_t), lane_.stream()), "cudaMemsetAsync");
    scan_counts(counts.data(), count + 1, base, counts.data(), scratch_.data(), scratch_.size(),
                lane_.stream());
    copy_async(host, counts.data(), (count + 1) * sizeof(uint64_t), cudaMemcpyDeviceToHost, lane_);
    lane_.synchronize();
  }

  // Hands out the offsets of `count` rays and of what follows them.
  void write_offsets(uint64_t first, uint64_t count)
  {
    const uint64_t bytes = (count + 1) * sizeof(uint64_t);
    if (request_.device_memory)
      copy_async(request_.offsets + first, hit_offsets_.data(), bytes, cudaMemcpyDeviceToDevice, lane_);
    else std::memcpy(request_.offsets + first, host_offsets_, bytes);
  }

  // Nothing runs on the buffer when it is replaced; the smaller one is given back first.
  template <class T>
  void grow(DeviceBuffer<T> &buffer, uint64_t count, const char *what)
  {
    if (buffer.size() >= count) return;
    buffer = {};
    buffer = DeviceBuffer<T>(context_.memory, count, what);
  }

  const QueryContext &context_;
  const TraceRequest &request_;
  Lane &lane_;
  const uint64_t chunk_rays_;
  const DeviceBuffer<Ray> rays_;
  const DeviceBuffer<uint64_t> listed_offsets_, hit_offsets_;
  const DeviceBuffer<std::byte> scratch_;
  DeviceBuffer<Hit> listed_;
  DeviceBuffer<std::byte> results_;
  WaitAtEnd wait_;  // goes first, so that no buffer goes while it is in use
  uint64_t *host_listed_ = nullptr, *host_offsets_ = nullptr;
  uint64_t num_hits_ = 0;
};

}  // namespace

void trace_batch(const QueryContext &context, const TraceRequest &request)
{
  if (request.device_memory) check_device_pointers(request, context.memory->ordinal());
  if (request.query == QueryKind::All) {
    const LaneLease lane = context.lanes.acquire();
    AllHitsQuery(context, request, *lane).run();
  } else if (request.num_rays == 0) return;
  else if (request.count_lanes) trace_counting(context, request);
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
  const uint64_t slice = slice_of(request, context.slice.get()), result_bytes = result_bytes_of(request);
  const StreamWords scratch(*context.memory, stream, trace_scratch_words(std::min(slice, request.num_rays)));
  for (uint64_t first = 0; first < request.num_rays; first += slice) {
    launch_hits(context, request, nullptr, request.rays + first, std::min(slice, request.num_rays - first),
                results_of(request) + first * result_bytes, scratch.data(), stream);
  }
  if (done_event != nullptr) check(cudaEventRecord(done_event, stream), "cudaEventRecord");
}

}  // namespace gpurt::cuda
