// A scene committed to the CPU: its accelerator and the queries over it.
#pragma once

#include <tbb/task_arena.h>

#include "backend.h"
#include "cpu/accel/accelerator.h"
#include "cpu/path/path_kernel.h"

namespace gpurt {

class CpuScene final : public CommittedScene {
 public:
  CpuScene(std::shared_ptr<const CompiledScene> scene, std::unique_ptr<Accelerator> accelerator,
           std::shared_ptr<tbb::task_arena> arena, std::shared_ptr<MemoryTracker> memory);

  const AccelFacts &accel_facts() const override { return accelerator_->facts(); }
  void trace(const TraceRequest &request) const override;
  void render(const RenderPass &pass) const override;
  void require_photons() const override {}
  void require_photon_statistics() const override {}
  PhotonPilot photon_pilot(const PathSettings &settings, const EmissionView &emission, uint32_t num_paths,
                           uint32_t points_per_axis, const TakePilotPhotons &take) const override;
  std::shared_ptr<const PhotonMap> photon_map(const PathSettings &settings, const EmissionView &emission,
                                              const ScenePhotonRequest &request) const override;
  void require_reyes() const override {}
  HostKdTree export_tree(uint32_t tree) const override { return accelerator_->export_tree(tree); }

  Schedule resolve_schedule(const Schedule &asked, ScheduleUse) const override
  {
    return resolve_fused_schedule(asked, "the CPU device");
  }

  const CpuAccel &accel() const { return accelerator_->queries(); }

 private:
  void trace_closest_hits(const TraceRequest &request) const;
  void trace_any_hits(const TraceRequest &request) const;
  void trace_all_hits(const TraceRequest &request) const;
  void write_hits(const TraceRequest &request, uint64_t first, const Hit *hits, uint64_t n) const;

  std::shared_ptr<const CompiledScene> scene_;
  SceneView view_;
  std::unique_ptr<Accelerator> accelerator_;
  std::shared_ptr<tbb::task_arena> arena_;
  std::shared_ptr<MemoryTracker> memory_;
};

}  // namespace gpurt
