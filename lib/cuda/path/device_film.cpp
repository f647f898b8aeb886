#include "cuda/path/device_film.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <cstring>

#include "cuda/path/film_kernels.h"
#include "cuda/path/group_film.h"
#include "error.h"
#include "memory.h"

namespace gpurt::cuda {
namespace {

// Host memory that is not page-locked is reached by way of slots that are: while the host copies one, the device fills others.
constexpr uint64_t slot_bytes = uint64_t(2) << 20;
constexpr unsigned num_slots = 4;
constexpr uint64_t copied_together = uint64_t(1) << 18;
// Pixels that are resolved together: a slot has room for three values of each.
constexpr uint64_t resolved_together = uint64_t(1) << 17;
static_assert(resolved_together * 3 * sizeof(uint32_t) <= slot_bytes);

// Behind the film's arrays.
constexpr uint64_t found_bytes = 256;

uint64_t aligned(uint64_t bytes) { return (bytes + found_bytes - 1) / found_bytes * found_bytes; }

void copy_by_all_threads(void *to, const void *from, uint64_t bytes)
{
  // Whoever waits for it must not begin another of its own tasks meanwhile, which may use the same film.
  tbb::this_task_arena::isolate([&] {
    tbb::parallel_for(uint64_t(0), (bytes + copied_together - 1) / copied_together, [&](uint64_t i) {
      const uint64_t first = i * copied_together;
      std::memcpy(static_cast<std::byte *>(to) + first, static_cast<const std::byte *>(from) + first,
                  std::min(copied_together, bytes - first));
    });
  });
}

struct Slots {
  explicit Slots(PinnedBuffer &memory)
      : base(static_cast<std::byte *>(memory.reserve(num_slots * slot_bytes)))
  {}
  std::byte *at(uint64_t turn) const { return base + turn % num_slots * slot_bytes; }
  Event &event(uint64_t turn) { return events[turn % num_slots]; }

  std::byte *base;
  std::array<Event, num_slots> events{Event(cudaEventDisableTiming), Event(cudaEventDisableTiming),
                                      Event(cudaEventDisableTiming), Event(cudaEventDisableTiming)};
};

// Calls fill(slot, turn), which queues what fills a slot, and take(slot, turn) for what is in it then, turn after turn.
template <class Fill, class Take>
void by_slots(Lane &lane, uint64_t num_turns, Fill &&fill, Take &&take)
{
  Slots slots(lane.to_host);
  const WaitAtEnd wait(lane.stream());
  uint64_t queued = 0;
  for (uint64_t turn = 0; turn < num_turns; ++turn) {
    for (; queued < std::min<uint64_t>(turn + num_slots, num_turns); ++queued) {
      fill(slots.at(queued), queued);
      slots.event(queued).record(lane.stream());
    }
    slots.event(turn).wait();
    take(slots.at(turn), turn);
  }
}

void copy_to_host(Lane &lane, std::byte *to, const std::byte *from, uint64_t bytes, bool &has_begun)
{
  const auto bytes_of = [&](uint64_t turn) { return std::min(slot_bytes, bytes - turn * slot_bytes); };
  by_slots(
      lane, (bytes + slot_bytes - 1) / slot_bytes,
      [&](std::byte *slot, uint64_t turn) {
        check(cudaMemcpyAsync(slot, from + turn * slot_bytes, bytes_of(turn), cudaMemcpyDeviceToHost,
                              lane.stream()),
              "cudaMemcpyAsync");
      },
      [&](const std::byte *slot, uint64_t turn) {
        has_begun = true;
        copy_by_all_threads(to + turn * slot_bytes, slot, bytes_of(turn));
      });
}

void copy_to_device(Lane &lane, std::byte *to, const std::byte *from, uint64_t bytes)
{
  Slots slots(lane.to_device);
  const WaitAtEnd wait(lane.stream());
  for (uint64_t turn = 0; turn * slot_bytes < bytes; ++turn) {
    const uint64_t first = turn * slot_bytes, n = std::min(slot_bytes, bytes - first);
    if (turn >= num_slots) slots.event(turn).wait();
    copy_by_all_threads(slots.at(turn), from + first, n);
    check(cudaMemcpyAsync(to + first, slots.at(turn), n, cudaMemcpyHostToDevice, lane.stream()),
          "cudaMemcpyAsync");
    slots.event(turn).record(lane.stream());
  }
  lane.synchronize();
}

// Where the device can write to the caller's memory itself; null: only the host can.
uint32_t *reached_by_device(void *data, uint64_t bytes, int ordinal, bool &is_device_memory)
{
  cudaPointerAttributes first{}, last{};
  check(cudaPointerGetAttributes(&first, data), "cudaPointerGetAttributes");
  check(cudaPointerGetAttributes(&last, static_cast<std::byte *>(data) + bytes - 1),
        "cudaPointerGetAttributes");
  is_device_memory = first.type == cudaMemoryTypeDevice;
  if (is_device_memory) check_device_pointer(data, "data", ordinal, "the frame");
  if (first.type == cudaMemoryTypeUnregistered || first.type != last.type || first.devicePointer == nullptr)
    return nullptr;
  return static_cast<uint32_t *>(first.devicePointer);
}

}  // namespace

CudaFilm::CudaFilm(std::shared_ptr<void> device, const std::shared_ptr<DeviceMemory> &memory, LanePool &lanes,
                   FilmBudget &budget, uint32_t width, uint32_t height, uint32_t outputs)
    : device_(std::move(device)),
      memory_(memory),
      lanes_(lanes),
      budget_(budget),
      width_(width),
      height_(height),
      outputs_(outputs),
      film_bytes_(GroupFilm(uint64_t(width) * height, outputs).bytes())
{}

CudaFilm::~CudaFilm()
{
  if (data_ == nullptr) return;
  // The frame's reservation counts again.
  memory_->tracker()->retake(film_bytes_);
  memory_->free(data_, aligned(film_bytes_) + found_bytes);
  budget_.used -= film_bytes_;
}

void CudaFilm::reserve()
{
  if (data_ != nullptr) return;
  const uint64_t before = budget_.used.fetch_add(film_bytes_);
  if (before + film_bytes_ > budget_.most) {
    budget_.used -= film_bytes_;
    fail(GPURT_ERROR_OUT_OF_MEMORY, "films on the device hold {} bytes, and may hold {}", before,
         budget_.most);
  }
  // What the frame has reserved for its film is for this one.
  memory_->tracker()->release(film_bytes_);
  try {
    data_ = static_cast<std::byte *>(
        memory_->allocate(aligned(film_bytes_) + found_bytes, "the frame's film on the device"));
  } catch (...) {
    memory_->tracker()->retake(film_bytes_);
    budget_.used -= film_bytes_;
    throw;
  }
}

FilmView CudaFilm::view() const
{
  return GroupFilm(uint64_t(width_) * height_, outputs_).view(data_, width_, height_);
}

// An array of the film on the host, and where its values are here.
struct CudaFilm::Part {
  std::byte *here;
  const void *host;
  uint64_t bytes;
};

std::vector<CudaFilm::Part> CudaFilm::parts(const TileFilm &film) const
{
  std::vector<Part> all;
  const FilmView v = view();
  const auto add = [&](auto *here, const auto &host) {
    if (here == nullptr) return;
    all.push_back({reinterpret_cast<std::byte *>(here), host.data(), host.size() * sizeof *here});
  };
  add(v.pixels, film.pixels);
  add(v.features, film.features);
  add(v.first_hits, film.first_hits);
  return all;
}

void CudaFilm::upload(const TileFilm &from)
{
  const DeviceScope scope(memory_->ordinal());
  reserve();
  const LaneLease lane = lanes_.acquire();
  for (const Part &part : parts(from))
    copy_to_device(*lane, part.here, static_cast<const std::byte *>(part.host), part.bytes);
  is_empty_ = false;
}

void CudaFilm::download(TileFilm &to, bool &has_begun) const
{
  const DeviceScope scope(memory_->ordinal());
  const LaneLease lane = lanes_.acquire();
  for (const Part &part : parts(to)) {
    // Of the arrays of `to`, which are not const.
    copy_to_host(*lane, static_cast<std::byte *>(const_cast<void *>(part.host)), part.here, part.bytes,
                 has_begun);
  }
}

bool CudaFilm::resolve(gpurt_output output, void *data, uint64_t bytes) const
{
  if (output > GPURT_OUTPUT_VARIANCE) return false;
  const DeviceScope scope(memory_->ordinal());
  const LaneLease lane = lanes_.acquire();
  const FilmView film = view();
  const auto wanted = FilmOutput(output);
  const uint64_t num_pixels = uint64_t(width_) * height_;
  bool is_device_memory = false;
  if (uint32_t *values = reached_by_device(data, bytes, memory_->ordinal(), is_device_memory)) {
    if (is_device_memory) lane->wait_for_default_stream();
    launch_resolve(film, wanted, 0, num_pixels, values, lane->stream());
    lane->synchronize();
    return true;
  }
  const uint64_t turn_bytes = resolved_together * num_values(wanted) * sizeof(uint32_t);
  by_slots(
      *lane, (num_pixels + resolved_together - 1) / resolved_together,
      [&](std::byte *slot, uint64_t turn) {
        const uint64_t first = turn * resolved_together;
        launch_resolve(film, wanted, first, std::min(resolved_together, num_pixels - first),
                       reinterpret_cast<uint32_t *>(slot), lane->stream());
      },
      [&](const std::byte *slot, uint64_t turn) {
        copy_by_all_threads(static_cast<std::byte *>(data) + turn * turn_bytes, slot,
                            std::min(turn_bytes, bytes - turn * turn_bytes));
      });
  return true;
}

bool CudaFilm::takes_whole(std::span<const UnitGroup> groups) const
{
  if (!is_empty_ || groups.size() != 1) return false;
  const WorkUnit &u = groups[0].bounds;
  return u.x0 == 0 && u.y0 == 0 && u.x1 == width_ && u.y1 == height_;
}

FilmFinds CudaFilm::add(const UnitGroup &group, std::byte *data, Lane &lane)
{
  const WorkUnit &u = group.bounds;
  const FilmView from = GroupFilm(group.num_pixels(), outputs_).view(data, u.x1 - u.x0, u.y1 - u.y0);
  auto *const found = reinterpret_cast<FilmFindings *>(data_ + aligned(film_bytes_));
  if (is_empty_ && data != data_)
    check(cudaMemsetAsync(data_, 0, film_bytes_, lane.stream()), "cudaMemsetAsync");
  check(cudaMemsetAsync(found, 0, sizeof *found, lane.stream()), "cudaMemsetAsync");
  launch_add_group(view(), from, u.x0, u.y0, found, lane.stream());
  auto *const on_host = static_cast<FilmFindings *>(lane.to_host.reserve(sizeof *found));
  check(cudaMemcpyAsync(on_host, found, sizeof *found, cudaMemcpyDeviceToHost, lane.stream()),
        "cudaMemcpyAsync");
  lane.synchronize();
  is_empty_ = false;
  return {on_host->num_nonfinite, on_host->num_saturated};
}

CudaFilm *reserved_film(const RenderPass &pass)
{
  if (pass.on_device == nullptr) return nullptr;
  // A pass has a film that its own scene made.
  auto *const film = static_cast<CudaFilm *>(pass.on_device->film);
  film->reserve();
  return film;
}

void hand_over(const RenderPass &pass, const UnitGroup &group, std::byte *film, Lane &lane,
               const RenderCounters &counters, bool has_eye_rays)
{
  if (pass.on_device != nullptr) {
    RenderCounters c = counters;
    c.num_samples = group.num_paths();
    if (has_eye_rays) c.num_camera_rays = c.num_samples;
    pass.on_device->deliver(group.units, c, [&] {
      return static_cast<CudaFilm *>(pass.on_device->film)->add(group, film, lane);
    });
    return;
  }
  const GroupFilm layout(group.num_pixels(), pass.outputs);
  auto *const host = static_cast<std::byte *>(lane.to_host.reserve(layout.bytes()));
  check(cudaMemcpyAsync(host, film, layout.bytes(), cudaMemcpyDeviceToHost, lane.stream()),
        "cudaMemcpyAsync");
  lane.synchronize();
  const WorkUnit &u = group.bounds;
  deliver(pass, group, layout.view(host, u.x1 - u.x0, u.y1 - u.y0), counters, has_eye_rays);
}

}  // namespace gpurt::cuda
