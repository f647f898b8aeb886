// The photons of passes that fly together on the device, traced into one map after another, each as large as memory allows.
//
// A map is full where a step of the photons in flight may not find room for what it leaves behind. They stay in flight while
// the map is used, and go on into the next one: nothing is lost, and nothing traced twice.
#pragma once

#include "backend.h"
#include "cuda/photon/flight.h"
#include "cuda/photon/kernels.h"
#include "cuda/photon/pass_queue.h"

namespace gpurt::cuda {

class PhotonStore {
 public:
  /// For up to `capacity` photons in flight, of as many as most_slots passes. Throws OUT_OF_MEMORY where a map of some times
  /// as many photons has no room.
  PhotonStore(PassQueue &queue, uint32_t capacity, uint32_t most_slots);

  /// Turns to the photons of `num_slots` passes, num_emitted in all.
  void begin(const PhotonFlight &flight, uint32_t num_emitted, uint32_t num_slots);
  /// Traces further photons of the passes into records. False: cancelled. Throws OUT_OF_MEMORY, UNSUPPORTED.
  bool trace();
  /// Sorts the records into grids for gathers within `radius` or less, one behind the other, which the stream then has:
  /// that of slot s has the view's starts from s * table_size on.
  PhotonGrid build(float radius);
  /// Whether no photons are left to trace.
  bool is_last() const { return num_started_ == num_emitted_ && num_flying_ == 0; }
  uint64_t num_records() const { return num_stored_; }
  /// Copies the records to host or device memory.
  void read_records(Photon *to) const;

  /// Of all passes so far, less times; radii are the caller's.
  PhotonCounters counters;

 private:
  struct Map;
  bool make_room(uint64_t wanted);
  std::unique_ptr<Map> make_map(uint64_t capacity) const;
  uint64_t affordable() const;
  const FlightNumbers &read_numbers();

  PassQueue &queue_;
  const uint32_t capacity_, most_slots_;
  DeviceBuffer<std::byte> buffer_;
  PhotonQueue queues_[2] = {};
  Hit *hits_ = nullptr;
  uint32_t *trace_scratch_ = nullptr;
  FlightNumbers *numbers_ = nullptr;

  struct Map {
    uint64_t capacity;
    DeviceBuffer<Photon> records;
    DeviceBuffer<std::byte> grid;
    GridTarget target;
    std::byte *work;
    uint64_t work_bytes;
    uint64_t bytes() const { return records.bytes() + grid.bytes(); }
  };
  std::unique_ptr<Map> map_;

  PhotonFlight flight_{};
  uint32_t num_slots_ = 1, num_emitted_ = 0, num_started_ = 0, num_flying_ = 0;
  int from_ = 0;  // the queue that the photons in flight are in
  uint64_t num_stored_ = 0;
  Box bounds_ = empty_box();  // of the records
};

}  // namespace gpurt::cuda
