#include "cuda/photon/photon_store.h"

#include <algorithm>

#include "cuda/layout.h"
#include "error.h"

namespace gpurt::cuda {
namespace {

struct FlightArrays {
  PhotonQueue queues[2];
  Hit *hits;
  uint32_t *trace_scratch;
  FlightNumbers *numbers;
  uint64_t bytes;
};

FlightArrays lay_out(std::byte *base, uint64_t n, bool has_media)
{
  Layout layout(base);
  FlightArrays a;
  for (PhotonQueue &q : a.queues)
    q = {layout.take<FlyingPhoton>(n), layout.take<Ray>(n), layout.take<uint32_t>(n),
         has_media ? layout.take<uint32_t>(n) : nullptr};
  a.hits = layout.take<Hit>(n);
  a.trace_scratch = layout.take<uint32_t>(trace_scratch_words(n));
  a.numbers = layout.take<FlightNumbers>(1);
  a.bytes = layout.bytes();
  return a;
}

// Entries of the largest tables that make_grid_shape chooses.
uint64_t largest_tables(uint64_t num_photons, uint32_t num_slots)
{
  return std::min(std::max(num_photons * 5 / 2, uint64_t(4096) * num_slots), uint64_t(1) << 31);
}

// What a photon of a map takes, about: its record, probe, rest and entries, the sort's keys and indices, and what the sort
// works on.
constexpr uint64_t bytes_per_photon = sizeof(Photon) + sizeof(PhotonProbe) + sizeof(PhotonRest) + 10 + 16 + 2;

// Of all photons in flight, that a map has room for at least.
constexpr uint64_t steps_per_map = 4;

}  // namespace

PhotonStore::PhotonStore(PassQueue &queue, uint32_t capacity, uint32_t most_slots)
    : queue_(queue),
      capacity_(capacity),
      most_slots_(most_slots),
      buffer_(queue.memory, lay_out(nullptr, capacity, queue.scene.scene.has_absorption != 0).bytes,
              "photons in flight")
{
  const FlightArrays a = lay_out(buffer_.data(), capacity, queue.scene.scene.has_absorption != 0);
  queues_[0] = a.queues[0];
  queues_[1] = a.queues[1];
  hits_ = a.hits;
  trace_scratch_ = a.trace_scratch;
  numbers_ = a.numbers;
  // A map that a few steps fill would be built, and gathered from, all too often.
  const uint64_t wanted = steps_per_map * capacity, affordable = this->affordable();
  if (affordable < wanted) {
    fail(GPURT_ERROR_OUT_OF_MEMORY,
         "a map of {} photons is more than half of the device memory that is left; raise memory_limit_bytes "
         "or "
         "make the scene or frame smaller",
         wanted);
  }
  map_ = make_map(wanted);
}

// Photons that a map may hold so that it takes half of what the device or its limit leaves, the rest being others'.
uint64_t PhotonStore::affordable() const
{
  uint64_t whole = queue_.memory->tracker()->limit();
  if (whole == 0) {
    size_t free_bytes = 0, total_bytes = 0;
    check(cudaMemGetInfo(&free_bytes, &total_bytes), "cudaMemGetInfo");
    whole = total_bytes;
  }
  const uint64_t used = queue_.memory->tracker()->used() - (map_ ? map_->bytes() : 0);
  return std::min<uint64_t>(whole > used ? (whole - used) / 2 / bytes_per_photon : 0, max_photons);
}

std::unique_ptr<PhotonStore::Map> PhotonStore::make_map(uint64_t capacity) const
{
  auto map = std::make_unique<Map>();
  map->capacity = capacity;
  map->records = {queue_.memory, capacity, "photons"};
  GridShape shape{};
  shape.table_size = uint32_t(largest_tables(capacity, most_slots_));
  const auto lay_out = [&](std::byte *base) {
    Layout layout(base);
    map->target = {layout.take<uint32_t>(uint64_t(shape.table_size) + 1), layout.take<PhotonProbe>(capacity),
                   layout.take<PhotonRest>(capacity), nullptr, false};
    map->work_bytes = grid_build_bytes(shape, capacity);
    map->work = layout.take<std::byte>(map->work_bytes);
    return layout.bytes();
  };
  map->grid = {queue_.memory, lay_out(nullptr), "a grid of photons"};
  lay_out(map->grid.data());
  return map;
}

// Makes room for `wanted` records, if that is to be had.
bool PhotonStore::make_room(uint64_t wanted)
{
  if (wanted <= map_->capacity) return true;
  const uint64_t affordable = this->affordable();
  if (wanted > affordable) return false;
  std::unique_ptr<Map> larger;
  try {
    larger = make_map(std::min(affordable, wanted + wanted / 2));
  } catch (const Error &e) {
    if (e.result() != GPURT_ERROR_OUT_OF_MEMORY) throw;
    return false;
  }
  check(cudaMemcpyAsync(larger->records.data(), map_->records.data(), num_stored_ * sizeof(Photon),
                        cudaMemcpyDeviceToDevice, queue_.stream),
        "cudaMemcpyAsync");
  check(cudaStreamSynchronize(queue_.stream), "cudaStreamSynchronize");
  map_ = std::move(larger);
  return true;
}

void PhotonStore::begin(const PhotonFlight &flight, uint32_t num_emitted, uint32_t num_slots)
{
  flight_ = flight;
  num_slots_ = num_slots;
  num_emitted_ = num_emitted;
  num_started_ = num_flying_ = 0;
  num_stored_ = 0;
  check(cudaMemsetAsync(&numbers_->missing, 0, sizeof numbers_->missing, queue_.stream), "cudaMemsetAsync");
}

const FlightNumbers &PhotonStore::read_numbers()
{
  check(cudaMemcpyAsync(queue_.numbers, numbers_, sizeof *numbers_, cudaMemcpyDeviceToHost, queue_.stream),
        "cudaMemcpyAsync");
  check(cudaStreamSynchronize(queue_.stream), "cudaStreamSynchronize");
  return *reinterpret_cast<const FlightNumbers *>(queue_.numbers);
}

bool PhotonStore::trace()
{
  num_stored_ = 0;
  bounds_ = empty_box();
  check(cudaMemsetAsync(&numbers_->stored, 0, sizeof *numbers_ - offsetof(FlightNumbers, stored),
                        queue_.stream),
        "cudaMemsetAsync");
  while (!is_last()) {
    if (queue_.is_cancelled()) return false;
    const uint32_t num_new = std::min(capacity_ - num_flying_, num_emitted_ - num_started_);
    const uint32_t n = num_flying_ + num_new;
    if (!make_room(num_stored_ + n)) break;
    const PhotonQueue &from = queues_[from_];
    if (num_new != 0) {
      launch_emit_photons(flight_, from, num_started_, num_flying_, num_new, numbers_, queue_.stream);
      queue_.mark(PhotonLap::Emit);
    }
    num_started_ += num_new;
    queue_.trace(from.rays, n, hits_, Coherence::Incoherent, from.left_out, trace_scratch_);
    queue_.mark(PhotonLap::Photons);
    check(cudaMemsetAsync(&numbers_->next, 0, sizeof numbers_->next, queue_.stream), "cudaMemsetAsync");
    launch_scatter_photons(flight_, from, hits_, n, queues_[1 - from_], map_->records.data(), numbers_,
                           queue_.stream);
    queue_.mark(PhotonLap::Scatter);
    const FlightNumbers numbers = read_numbers();
    num_flying_ = numbers.next;
    num_stored_ = numbers.stored;
    bounds_ = bounds_of(numbers.bounds);
    from_ = 1 - from_;
    counters.num_rays += n;
    if (is_last()) counters.num_rays -= numbers.missing;
  }
  counters.num_stored += num_stored_;
  counters.num_sub_passes += num_slots_;
  if (is_last()) counters.num_emitted += num_emitted_;
  return true;
}

PhotonGrid PhotonStore::build(float radius)
{
  const PhotonSource source{map_->records.data(), nullptr, nullptr, nullptr, num_stored_};
  const GridShape shape = make_grid_shape(bounds_, radius, num_stored_ / num_slots_);
  if (grid_build_bytes(shape, source.num_photons, num_slots_) > map_->work_bytes)
    fail(GPURT_ERROR_INTERNAL, "a grid of {} photons wants more memory than one of {}", num_stored_,
         map_->capacity);
  launch_build_grid(shape, source, map_->target, map_->work, queue_.stream, num_slots_);
  queue_.mark(PhotonLap::Build);
  return {shape, map_->target.starts, map_->target.probes, map_->target.rests, nullptr, num_stored_};
}

void PhotonStore::read_records(Photon *to) const
{
  check(cudaMemcpyAsync(to, map_->records.data(), num_stored_ * sizeof(Photon), cudaMemcpyDefault,
                        queue_.stream),
        "cudaMemcpyAsync");
  check(cudaStreamSynchronize(queue_.stream), "cudaStreamSynchronize");
}

}  // namespace gpurt::cuda
