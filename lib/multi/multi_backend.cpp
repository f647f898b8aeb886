#include "multi/multi_backend.h"

#include "error.h"
#include "multi/multi_scene.h"
#include "photon_maps.h"

namespace gpurt::multi {
namespace {

DeviceInfo joined_info(const Members &members)
{
  DeviceInfo info = members.backends[0]->info();
  bool same_names = true;
  std::string names = info.name;
  for (size_t i = 1; i < members.size(); ++i) {
    const DeviceInfo &other = members.backends[i]->info();
    info.num_threads += other.num_threads;
    info.memory_bytes += other.memory_bytes;
    info.compute_capability = std::min(info.compute_capability, other.compute_capability);
    same_names = same_names && other.name == info.name;
    names += ", " + other.name;
  }
  info.name = same_names ? fmt::format("{} x {}", members.size(), info.name) : names;
  return info;
}

std::shared_ptr<MemoryTracker> joined_memory(const Members &members)
{
  uint64_t limit = 0;
  for (const auto &backend : members.backends) {
    // One without a limit leaves the sum without one.
    if (backend->memory()->limit() == 0) return std::make_shared<MemoryTracker>(0);
    limit += backend->memory()->limit();
  }
  return std::make_shared<MemoryTracker>(limit);
}

class MultiBackend final : public Backend, public StreamOrdering, public PhotonMaps {
 public:
  explicit MultiBackend(std::vector<std::unique_ptr<Backend>> backends)
      : members_(std::make_shared<Members>(Members{std::move(backends)})),
        info_(joined_info(*members_)),
        memory_(joined_memory(*members_))
  {
    for (const auto &backend : members_->backends) backend->memory()->count_in(memory_);
  }

  const DeviceInfo &info() const override { return info_; }
  const std::shared_ptr<MemoryTracker> &memory() const override { return memory_; }

  std::shared_ptr<const CommittedScene> commit(std::shared_ptr<const CompiledScene> scene,
                                               const BuildOptions &options) override
  {
    std::vector<std::shared_ptr<const CommittedScene>> scenes(members_->size());
    const auto commit_on = [&](size_t i) {
      BuildOptions member_options = options;
      if (i != 0 && options.accel == Accel::Auto) member_options.accel = scenes[0]->accel_facts().accel;
      // Its own part of the commit before.
      if (const auto *previous = dynamic_cast<const MultiScene *>(options.previous.get()))
        member_options.previous = previous->member(i);
      run_named(*members_, i, [&] { scenes[i] = members_->backends[i]->commit(scene, member_options); });
    };
    // A tree that goes to a file is built once: the others read it there. What the first one chooses, the others take.
    const size_t first = options.cache_path.empty() && options.accel != Accel::Auto ? 0 : 1;
    if (first == 1) commit_on(0);
    run_side_by_side(scenes.size() - first, [&](size_t i) { commit_on(first + i); });
    return std::make_shared<MultiScene>(members_, std::move(scenes));
  }

  std::shared_ptr<void> allocate(uint64_t bytes) override { return members_->backends[0]->allocate(bytes); }
  void copy_to_host(void *host, const void *device, uint64_t bytes) override
  {
    members_->backends[members_->holder(device, "the buffer")]->copy_to_host(host, device, bytes);
  }
  void copy_to_device(void *device, const void *host, uint64_t bytes) override
  {
    members_->backends[members_->holder(device, "the buffer")]->copy_to_device(device, host, bytes);
  }
  bool holds(const void *data) const override
  {
    return std::any_of(members_->backends.begin(), members_->backends.end(),
                       [&](const auto &backend) { return backend->holds(data); });
  }

  std::shared_ptr<const PhotonMap> make_photon_map(const PhotonMapRequest &request) override
  {
    auto *const maps = dynamic_cast<PhotonMaps *>(members_->backends[0].get());
    if (!maps) fail(GPURT_ERROR_UNSUPPORTED, "{} has no photon maps", members_->name(0));
    return maps->make_photon_map(request);
  }

  void order_streams(uint32_t ordinal, void *stream, void *after) override
  {
    streams_of(ordinal).order_streams(ordinal, stream, after);
  }
  void wait_for_stream(uint32_t ordinal, void *stream) override
  {
    streams_of(ordinal).wait_for_stream(ordinal, stream);
  }

 private:
  StreamOrdering &streams_of(uint32_t ordinal) const
  {
    const size_t member = members_->with_ordinal(ordinal);
    auto *const streams = dynamic_cast<StreamOrdering *>(members_->backends[member].get());
    if (!streams) fail(GPURT_ERROR_UNSUPPORTED, "{} has no streams", members_->name(member));
    return *streams;
  }

  std::shared_ptr<const Members> members_;
  DeviceInfo info_;
  std::shared_ptr<MemoryTracker> memory_;
};

}  // namespace

std::unique_ptr<Backend> join(std::vector<std::unique_ptr<Backend>> backends)
{
  return std::make_unique<MultiBackend>(std::move(backends));
}

}  // namespace gpurt::multi
