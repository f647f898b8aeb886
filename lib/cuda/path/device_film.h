// The film of a frame in device memory: groups of units are added to it by a kernel, and outputs resolved from it.
#pragma once

#include "backend.h"
#include "cuda/lanes.h"
#include "cuda/path/unit_groups.h"

namespace gpurt::cuda {

/// What films of a device take of its memory together, and may take: the rest is for scenes and work.
struct FilmBudget {
  std::atomic<uint64_t> used{0};
  uint64_t most = 0;
};

class CudaFilm final : public DeviceFilm {
 public:
  /// Takes no memory yet. `device` is what memory, lanes and budget belong to.
  CudaFilm(std::shared_ptr<void> device, const std::shared_ptr<DeviceMemory> &memory, LanePool &lanes,
           FilmBudget &budget, uint32_t width, uint32_t height, uint32_t outputs);
  ~CudaFilm() override;

  void upload(const TileFilm &from) override;
  void download(TileFilm &to, bool &has_begun) const override;
  bool resolve(gpurt_output output, void *data, uint64_t bytes) const override;

  /// Takes the memory. Throws OUT_OF_MEMORY.
  void reserve();
  /// Once it is reserved: room for a film of all pixels, which is its own while it is empty.
  std::byte *data() const { return data_; }
  /// Whether groups of a pass can be rendered in its own memory: there is one, of all pixels, and no samples yet.
  bool takes_whole(std::span<const UnitGroup> groups) const;
  /// Adds a group's film, which may be data(), and waits for that. Its units have no samples that it has.
  FilmFinds add(const UnitGroup &group, std::byte *data, Lane &lane);

 private:
  struct Part;
  std::vector<Part> parts(const TileFilm &film) const;
  FilmView view() const;

  const std::shared_ptr<void> device_;
  const std::shared_ptr<DeviceMemory> memory_;
  LanePool &lanes_;
  FilmBudget &budget_;
  const uint32_t width_, height_, outputs_;
  const uint64_t film_bytes_;  // of which the frame has reserved as many
  std::byte *data_ = nullptr;
  bool is_empty_ = true;
};

/// The film of a pass, with its memory; null where units go to the host. Throws OUT_OF_MEMORY.
CudaFilm *reserved_film(const RenderPass &pass);

/// Hands the units of a finished group over: to the film on the device, or to the host. `film` lies in device memory. `counters`
/// are what the group did together, but for its samples. `has_eye_rays`: each of these had one.
void hand_over(const RenderPass &pass, const UnitGroup &group, std::byte *film, Lane &lane,
               const RenderCounters &counters, bool has_eye_rays);

}  // namespace gpurt::cuda
