// The photons of a pass, traced into one map after another, each as large as memory allows.
#pragma once

#include <tbb/enumerable_thread_specific.h>

#include <optional>
#include <vector>

#include "accel/tracked_array.h"
#include "cpu/photon/photon_grid.h"
#include "cpu/photon/render.h"

namespace gpurt {

class PhotonStore {
 public:
  /// Within the scene's arena. All arguments outlive this.
  PhotonStore(const RenderPass &pass, const PhotonPass &photon_pass, const CpuPhotonScene &scene);
  ~PhotonStore();

  /// Traces further photons of the pass and builds a grid of them. False: cancelled. Throws OUT_OF_MEMORY.
  bool fill();
  /// Whether no photons are left to trace.
  bool is_last() const { return next_ == photon_pass_.num_emitted; }
  PhotonGrid grid() const { return grid_->view(); }
  PhotonCounters counters() const { return counters_; }
  /// Photons of neighbouring paths. They count against the memory limit before they take memory.
  using Chunk = TrackedArray<Photon>;
  /// Traces a few chunks, in the order of paths, until is_last(). Throws OUT_OF_MEMORY.
  std::vector<Chunk> trace_some();

 private:
  struct Scratch;
  bool is_cancelled() const;
  uint64_t capacity() const;
  std::vector<Chunk> trace_chunks(uint32_t most_chunks);
  Chunk make_chunk(const PhotonChunk &traced) const;

  const RenderPass &pass_;
  const PhotonPass &photon_pass_;
  const CpuPhotonScene &scene_;
  std::unique_ptr<tbb::enumerable_thread_specific<Scratch>> scratches_;
  Reservation scratch_bytes_;
  uint32_t next_ = 0;  // photon
  std::optional<CpuPhotonGrid> grid_;
  PhotonCounters counters_;
};

}  // namespace gpurt
