// A scene that is committed on several devices.
#pragma once

#include "multi/members.h"

namespace gpurt::multi {

class MultiScene final : public CommittedScene, public StreamTracing {
 public:
  /// One scene for each of the members, in their order.
  MultiScene(std::shared_ptr<const Members> members,
             std::vector<std::shared_ptr<const CommittedScene>> scenes);

  const std::shared_ptr<const CommittedScene> &member(size_t i) const { return scenes_[i]; }
  const AccelFacts &accel_facts() const override { return facts_; }
  HostKdTree export_tree(uint32_t tree) const override;
  void render(const RenderPass &pass) const override;
  void require_reyes() const override { scenes_[0]->require_reyes(); }
  void require_photons() const override { scenes_[0]->require_photons(); }
  void require_photon_statistics() const override
  {
    fail(
        GPURT_ERROR_UNSUPPORTED,
        "photon.estimator is not supported by several devices that work as one: each pass needs what the one "
        "before left in the pixels; use one device, or GPURT_PHOTON_ESTIMATOR_MEMORYLESS");
  }
  uint64_t most_photon_passes() const override { return scenes_.size() * scenes_[0]->most_photon_passes(); }
  PhotonPilot photon_pilot(const PathSettings &settings, const EmissionView &emission, uint32_t num_paths,
                           uint32_t points_per_axis, const TakePilotPhotons &take) const override;
  std::shared_ptr<const PhotonMap> photon_map(const PathSettings &settings, const EmissionView &emission,
                                              const ScenePhotonRequest &request) const override;
  void trace(const TraceRequest &request) const override;
  Schedule resolve_schedule(const Schedule &asked, ScheduleUse use) const override
  {
    return scenes_[0]->resolve_schedule(asked, use);  // the others are of the same kind
  }
  ReyesSchedule resolve_reyes_schedule(const Schedule &asked, const ReyesSettings &settings) const override
  {
    return scenes_[0]->resolve_reyes_schedule(asked, settings);
  }
  void trace_on_stream(const TraceRequest &request, void *stream, void *wait_event,
                       void *done_event) const override;

 private:
  void render_photons(const RenderPass &pass) const;
  void trace_each(const TraceRequest &request) const;
  void trace_all(const TraceRequest &request) const;
  size_t holder(const TraceRequest &request) const;

  std::shared_ptr<const Members> members_;
  std::vector<std::shared_ptr<const CommittedScene>> scenes_;
  AccelFacts facts_;
};

}  // namespace gpurt::multi
