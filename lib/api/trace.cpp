// gpurt_scene_trace and gpurt_cuda_trace: check the request, hand it to the committed scene.
#include "api/descriptor.h"
#include "api/guard.h"
#include "api/objects.h"
#include "gpurt_cuda.h"

namespace gpurt::api {
namespace {

/// Memory that a request reads or writes.
struct Range {
  const char *name;
  uintptr_t first;
  uint64_t bytes;
};

// An array of a request, which must be there if it has elements.
Range checked_range(const char *name, const void *data, uint64_t count, uint64_t element_bytes,
                    size_t alignment)
{
  const auto first = reinterpret_cast<uintptr_t>(data);
  uint64_t bytes, last;
  if (__builtin_mul_overflow(count, element_bytes, &bytes) || __builtin_add_overflow(first, bytes, &last)) {
    fail_invalid("{}: {} elements of {} bytes reach past the end of memory", name, count, element_bytes);
  }
  if (!data && count != 0) fail_invalid("{} is NULL, but {} elements are needed", name, count);
  if (first % alignment != 0) fail_invalid("{} must be aligned to {} bytes", name, alignment);
  return {name, first, bytes};
}

void check_disjoint(const Range &a, const Range &b)
{
  if (a.bytes == 0 || b.bytes == 0) return;
  if (a.first < b.first + b.bytes && b.first < a.first + a.bytes) {
    fail_invalid("{} and {} overlap; give them memory of their own", a.name, b.name);
  }
}

void check_absent(const void *data, const char *name, const char *query)
{
  if (data) fail_invalid("{} must be NULL for {}", name, query);
}

TraceRequest checked_request(const gpurt_trace_desc &d, const Device &device)
{
  check_enum(d.query, GPURT_QUERY_ALL + 1, "query", "gpurt_query");
  check_enum(d.format, GPURT_HIT_COMPACT + 1, "format", "gpurt_hit_format");
  check_enum(d.storage, GPURT_STORAGE_DEVICE + 1, "storage", "gpurt_storage");

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
    const TraceRequest request = checked_request(read_descriptor(desc), *s->device);
    const auto commit = s->require_commit();  // held until the end: a commit meanwhile does not disturb
    commit->committed->trace(request);
  });
}

gpurt_result gpurt_cuda_trace(gpurt_scene scene, const gpurt_trace_desc *desc, void *stream, void *wait_event,
                              void *done_event)
{
  return guard([&] {
    const auto s = get(scene, "scene");
    const TraceRequest request = checked_request(read_descriptor(desc), *s->device);
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
    tracing->trace_on_stream(request, stream, wait_event, done_event);
  });
}
