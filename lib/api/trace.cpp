// gpurt_scene_trace and gpurt_cuda_trace: check the request, hand it to the committed scene.
#include <algorithm>

#include "api/descriptor.h"
#include "api/guard.h"
#include "api/memory_range.h"
#include "api/objects.h"
#include "api/read_schedule.h"
#include "gpurt_cuda.h"
#include "schedule_desc.h"

namespace gpurt::api {
namespace {

TraceRequest checked_request(const gpurt_trace_desc &d, const Device &device)
{
  check_enum(d.query, GPURT_QUERY_ALL + 1, "query", "gpurt_query");
  check_enum(d.format, GPURT_HIT_COMPACT + 1, "format", "gpurt_hit_format");
  check_enum(d.storage, GPURT_STORAGE_DEVICE + 1, "storage", "gpurt_storage");
  check_enum(d.coherence, GPURT_COHERENCE_INCOHERENT + 1, "coherence", "gpurt_coherence");

  TraceRequest request;
  request.query = QueryKind(d.query);
  request.compact = d.format == GPURT_HIT_COMPACT;
  request.device_memory = d.storage == GPURT_STORAGE_DEVICE && !device.is_cpu();
  request.num_rays = d.num_rays;
  request.rays = reinterpret_cast<const Ray *>(d.rays);
  request.hits = d.hits;
  request.occluded = d.occluded;
  request.offsets = d.offsets;
  request.hit_capacity = d.hit_capacity;
  request.schedule = checked_schedule(d.schedule);
  request.coherence = Coherence(d.coherence);
  request.image_width = d.image_width;
  if (d.count_lanes > 1) fail_invalid("count_lanes is {}; it must be 0 or 1", d.count_lanes);
  check_reserved(d.reserved, "reserved");
  request.count_lanes = d.count_lanes != 0;
  if (request.count_lanes) {
    if (request.query != QueryKind::Closest) {
      fail(GPURT_ERROR_UNSUPPORTED,
           "count_lanes is set, but lanes are counted of closest hits alone; use GPURT_QUERY_CLOSEST, or set "
           "it "
           "to 0");
    }
    if (!d.out_counters)
      fail_invalid("count_lanes is set, but out_counters is NULL; give it, or set count_lanes to 0");
    if (device.is_cpu()) {
      fail(GPURT_ERROR_UNSUPPORTED,
           "count_lanes is set, but the CPU device has no warps; use a CUDA device, or set it to 0");
    }
  }

  const uint64_t hit_bytes = request.compact ? sizeof(gpurt_hit_compact) : sizeof(gpurt_hit);
  const Range rays = checked_range("rays", d.rays, d.num_rays, sizeof(gpurt_ray), alignof(gpurt_ray));
  switch (request.query) {
    case QueryKind::Closest:
      check_absent(d.occluded, "occluded", "GPURT_QUERY_CLOSEST");
      check_absent(d.offsets, "offsets", "GPURT_QUERY_CLOSEST");
      check_disjoint(rays, checked_range("hits", d.hits, d.num_rays, hit_bytes, alignof(gpurt_hit)));
      break;
    case QueryKind::Any:
      check_absent(d.hits, "hits", "GPURT_QUERY_ANY");
      check_absent(d.offsets, "offsets", "GPURT_QUERY_ANY");
      check_disjoint(rays, checked_range("occluded", d.occluded, d.num_rays, 1, 1));
      break;
    case QueryKind::All: {
      check_absent(d.occluded, "occluded", "GPURT_QUERY_ALL");
      if (d.num_rays == UINT64_MAX)
        fail_invalid("num_rays is {}; that many offsets cannot be counted", d.num_rays);
      const uint64_t num_offsets = d.num_rays + 1;
      const Range offsets =
          checked_range("offsets", d.offsets, num_offsets, sizeof(uint64_t), alignof(uint64_t));
      // Without hits the crossings are counted alone.
      const Range hits =
          checked_range("hits", d.hits, d.hits ? d.hit_capacity : 0, hit_bytes, alignof(gpurt_hit));
      check_disjoint(rays, offsets);
      check_disjoint(rays, hits);
      check_disjoint(hits, offsets);
      break;
    }
  }
  return request;
}

}  // namespace
}  // namespace gpurt::api

using namespace gpurt;
using namespace gpurt::api;

gpurt_result gpurt_scene_trace(gpurt_scene scene, const gpurt_trace_desc *desc)
{
  return guard([&] {
    const auto s = get(scene, "scene");
    const gpurt_trace_desc d = read_descriptor(desc);
    TraceRequest request = checked_request(d, *s->device);
    ScheduleCounters counters;
    if (d.out_counters) request.counters = &counters;
    const auto commit = s->require_commit();  // held until the end: a commit meanwhile does not disturb
    request.schedule = commit->committed->resolve_schedule(
        request.schedule, request.query == QueryKind::All ? ScheduleUse::AllHitsQuery : ScheduleUse::Query);
    commit->committed->trace(request);
    if (d.out_counters) *d.out_counters = describe(counters);
  });
}

gpurt_result gpurt_cuda_trace(gpurt_scene scene, const gpurt_trace_desc *desc, void *stream, void *wait_event,
                              void *done_event)
{
  return guard([&] {
    const auto s = get(scene, "scene");
    const gpurt_trace_desc d = read_descriptor(desc);
    TraceRequest request = checked_request(d, *s->device);
    if (s->device->is_cpu()) {
      fail(GPURT_ERROR_UNSUPPORTED,
           "the scene is on a CPU device, which has no streams; use gpurt_scene_trace");
    }
    const auto commit = s->require_commit();
    const auto *tracing = dynamic_cast<const StreamTracing *>(commit->committed.get());
    if (!tracing) {
      fail(GPURT_ERROR_UNSUPPORTED,
           "this build's CUDA backend does not trace on streams; use gpurt_scene_trace");
    }
    if (!request.device_memory) {
      fail_invalid(
          "work on a stream needs storage GPURT_STORAGE_DEVICE; host memory could change before it is read");
    }
    if (d.out_counters) {
      fail(GPURT_ERROR_UNSUPPORTED,
           "out_counters is set, but work on a stream is counted after the call has returned; use "
           "gpurt_scene_trace, or NULL");
    }
    request.schedule = commit->committed->resolve_schedule(request.schedule, ScheduleUse::StreamQuery);
    tracing->trace_on_stream(request, stream, wait_event, done_event);
  });
}

gpurt_result gpurt_cuda_get_kernels(gpurt_device device, gpurt_cuda_kernel *kernels, uint32_t capacity,
                                    uint32_t *out_count)
{
  return guard([&] {
    const auto object = get(device, "device");
    require(out_count, "out_count");
    const auto *listing = dynamic_cast<const KernelListing *>(object->backend.get());
    if (!listing) {
      fail(GPURT_ERROR_UNSUPPORTED,
           "kernels are those of one CUDA device, which this device is not; ask one that was created alone");
    }
    const std::vector<KernelInfo> infos = listing->kernels();
    for (size_t i = 0; kernels && i < std::min<size_t>(capacity, infos.size()); ++i) {
      const KernelInfo &k = infos[i];
      gpurt_cuda_kernel &out = kernels[i];
      out = {};
      out.name[k.name.copy(out.name, sizeof out.name - 1)] = 0;
      out.num_launches = k.num_launches;
      out.block_threads = k.block_threads;
      out.registers = k.registers;
      out.local_bytes = k.local_bytes;
      out.shared_bytes = k.shared_bytes;
      out.blocks_per_multiprocessor = k.blocks_per_multiprocessor;
      out.occupancy = k.occupancy;
    }
    *out_count = uint32_t(infos.size());
  });
}
