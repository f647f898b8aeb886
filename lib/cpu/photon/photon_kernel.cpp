// Runs the stages of photon mapping one after another on the calling thread; see photon_kernel.h.
#include "cpu/photon/photon_kernel.h"

#include "core/photon/photon_pipeline.h"
#include "cpu/path/serial_executor.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN
namespace {

class StoringExecutor : public SerialExecutor {
 public:
  StoringExecutor(const CpuAccel &accel, double (*seconds)(), PathKernelCounters &counters,
                  PhotonChunk &chunk)
      : SerialExecutor(accel, seconds, counters), chunk_(chunk)
  {}

  void store(const Photon *slots, uint32_t n)
  {
    for (uint32_t i = 0; i < n; ++i) {
      if (slots[i].bounce != 0) chunk_.photons[chunk_.num++] = slots[i];
    }
  }

 private:
  PhotonChunk &chunk_;
};

void trace(const CpuAccel &accel, const SceneView &scene, const EmissionView &emission,
           const PhotonUnit &unit, const PhotonWave &wave, uint32_t num_photons, PhotonChunk &chunk,
           double (*seconds)(), PhotonKernelCounters &counters)
{
  const double start = seconds();
  PathKernelCounters own{};
  StoringExecutor executor(accel, seconds, own, chunk);
  trace_photons(executor, scene, emission, unit, wave, num_photons);
  counters.num_photon_rays += own.num_camera_rays + own.num_bounce_rays;
  counters.emit_seconds += own.stage_seconds[uint32_t(PathStage::Generate)];
  counters.scatter_seconds += own.stage_seconds[uint32_t(PathStage::Shade)];
  counters.photon_seconds += seconds() - start;
}

void gather(const CpuAccel &accel, const SceneView &scene, const PathSettings &settings,
            const PhotonPass &pass, const PhotonGrid &grid, const PathUnit &unit, const PathWave &wave,
            const FilmView &film, const PixelStatistics *statistics, VisiblePoint *points,
            const PhotonSums &sums, uint32_t num_paths, double (*seconds)(), PhotonKernelCounters &counters)
{
  SerialExecutor executor(accel, seconds, counters.path);
  trace_visible_points(executor, scene, settings, pass, unit, wave, film, points, num_paths);
  if (statistics != nullptr) {
    executor.for_each(PathStage::Generate, num_paths,
                      SetPhotonRadii{unit, pass, statistics, settings.camera.width, points});
  }
  measure_discs(executor, scene, pass, wave, points, num_paths);
  const double start = seconds();
  for (uint32_t i = 0; i < num_paths; ++i) {
    if (points[i].depth == 0) continue;
    PhotonBlur none;
    if (sums.blurs != nullptr)
      gather_photons<1, true>(grid, pass, settings.max_depth, points[i], sums.sums[i], sums.blurs[i]);
    else gather_photons<1, false>(grid, pass, settings.max_depth, points[i], sums.sums[i], none);
  }
  counters.gather_seconds += seconds() - start;
}

void resolve(const PhotonPass &pass, const PathUnit &unit, const PathWave &wave, const FilmView &film,
             const VisiblePoint *points, const PhotonSums &sums, uint32_t num_paths,
             PhotonKernelCounters &counters)
{
  const uint32_t num_pixels = min(film.width * film.height, num_paths);
  const AddPhotonSamples stage{unit, wave, film, pass, points, sums, num_paths};
  for (uint32_t i = 0; i < num_pixels; ++i) stage(i);
  for (uint32_t i = 0; i < num_paths; ++i) {
    counters.num_visible += points[i].depth != 0;
    counters.num_gathered += sums.sums[i].num_photons;
    const float largest = max_component(sample_radiance(pass, wave.paths[i], points[i], sums.sums[i]));
    if (largest > counters.path.largest_sample) counters.path.largest_sample = largest;
  }
}

void find_points(const CpuAccel &accel, const SceneView &scene, const PathSettings &settings,
                 const PathUnit &unit, const PathWave &wave, VisiblePoint *points, uint32_t num_paths,
                 double (*seconds)())
{
  PathKernelCounters counters{};
  SerialExecutor executor(accel, seconds, counters);
  const FilmView no_film{};
  const PhotonPass no_pass{};
  trace_visible_points(executor, scene, settings, no_pass, unit, wave, no_film, points, num_paths);
}

}  // namespace

const PhotonKernels &photon_kernels()
{
  static constexpr PhotonKernels kernels{trace, gather, resolve, find_points};
  return kernels;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
