// Batches of rays on several devices: those in host memory are shared out, those in device memory stay where they are.
#include "error.h"
#include "multi/multi_scene.h"
#include "multi/shared_work.h"

namespace gpurt::multi {
namespace {

// Fewer rays than these go to one device: handing them out would take longer than tracing them.
constexpr uint64_t min_rays = uint64_t(1) << 18;
// All hits are found twice, first to count them, in parts of equal size.
constexpr uint64_t all_hits_parts_per_member = 4;

uint64_t hit_bytes(const TraceRequest &request)
{
  return request.compact ? sizeof(gpurt_hit_compact) : sizeof(gpurt_hit);
}

}  // namespace

size_t MultiScene::holder(const TraceRequest &request) const
{
  if (request.num_rays != 0) return members_->holder(request.rays, "rays");
  if (request.offsets != nullptr) return members_->holder(request.offsets, "offsets");
  return 0;
}

void MultiScene::trace(const TraceRequest &request) const
{
  const bool is_small = request.num_rays <= min_rays;
  if (request.device_memory || is_small) {
    const size_t member = request.device_memory ? holder(request) : 0;
    run_named(*members_, member, [&] { scenes_[member]->trace(request); });
  } else if (request.query == QueryKind::All) {
    trace_all(request);
  } else {
    trace_each(request);
  }
}

void MultiScene::trace_on_stream(const TraceRequest &request, void *stream, void *wait_event,
                                 void *done_event) const
{
  const size_t member = holder(request);
  const auto *tracing = dynamic_cast<const StreamTracing *>(scenes_[member].get());
  if (!tracing) fail(GPURT_ERROR_UNSUPPORTED, "{} does not trace on streams", members_->name(member));
  run_named(*members_, member, [&] { tracing->trace_on_stream(request, stream, wait_event, done_event); });
}

// Closest and any hits: every ray has a result of its own.
void MultiScene::trace_each(const TraceRequest &request) const
{
  SharedRange queue(request.num_rays, scenes_.size(), min_rays);
  std::atomic<bool> stop{false};
  std::vector<ScheduleCounters> counters(scenes_.size());
  run_side_by_side(scenes_.size(), [&](size_t member) {
    TraceRequest part = request;
    if (request.counters != nullptr) part.counters = &counters[member];
    uint64_t first;
    while (!stop && queue.take(first, part.num_rays)) {
      part.rays = request.rays + first;
      if (request.query == QueryKind::Any) part.occluded = request.occluded + first;
      else part.hits = static_cast<std::byte *>(request.hits) + first * hit_bytes(request);
      try {
        run_named(*members_, member, [&] { scenes_[member]->trace(part); });
      } catch (...) {
        stop = true;
        throw;
      }
    }
  });
  if (request.counters != nullptr) {
    for (const ScheduleCounters &c : counters) request.counters->add(c);
  }
}

// All hits: where those of a part begin is known once the parts before it are counted.
void MultiScene::trace_all(const TraceRequest &request) const
{
  const uint64_t num_parts = all_hits_parts_per_member * scenes_.size();
  const uint64_t part_rays = (request.num_rays + num_parts - 1) / num_parts;
  std::vector<uint64_t> first_hit(num_parts + 1);
  const auto for_each_part = [&](const auto &work) {
    std::atomic<uint64_t> next{0};
    run_side_by_side(scenes_.size(), [&](size_t member) {
      const Reservation reserved(members_->backends[member]->memory(), (part_rays + 1) * sizeof(uint64_t),
                                 "offsets of a part of the rays");
      std::vector<uint64_t> offsets(part_rays + 1);
      for (uint64_t p; (p = next++) < num_parts;) {
        const uint64_t first = std::min(p * part_rays, request.num_rays);
        TraceRequest part = request;
        part.rays = request.rays + first;
        part.num_rays = std::min(part_rays, request.num_rays - first);
        part.offsets = offsets.data();
        try {
          run_named(*members_, member, [&] { work(p, first, part, *scenes_[member]); });
        } catch (...) {
          next = num_parts;
          throw;
        }
      }
    });
  };

  for_each_part([&](uint64_t p, uint64_t first, TraceRequest &part, const CommittedScene &scene) {
    part.hits = nullptr;
    part.hit_capacity = 0;
    scene.trace(part);
    std::copy_n(part.offsets + 1, part.num_rays, request.offsets + first + 1);
    first_hit[p + 1] = part.offsets[part.num_rays];
  });
  request.offsets[0] = 0;
  for (uint64_t p = 0; p < num_parts; ++p) {
    first_hit[p + 1] += first_hit[p];
    const uint64_t end = std::min((p + 1) * part_rays, request.num_rays);
    for (uint64_t i = std::min(p * part_rays, request.num_rays); i < end; ++i)
      request.offsets[i + 1] += first_hit[p];
  }
  if (request.hits == nullptr) return;
  const uint64_t num_hits = first_hit[num_parts];
  if (num_hits > request.hit_capacity) {
    fail_invalid("the rays have {} hits, but hit_capacity is {}; make hits larger, offsets tell how large",
                 num_hits, request.hit_capacity);
  }
  for_each_part([&](uint64_t p, uint64_t, TraceRequest &part, const CommittedScene &scene) {
    part.hits = static_cast<std::byte *>(request.hits) + first_hit[p] * hit_bytes(request);
    part.hit_capacity = first_hit[p + 1] - first_hit[p];
    if (part.hit_capacity != 0) scene.trace(part);
  });
}

}  // namespace gpurt::multi
