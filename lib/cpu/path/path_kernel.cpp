// Runs the path pipeline's stages one after another on the calling thread; see path_kernel.h.
#include "cpu/path/path_kernel.h"

#include "cpu/path/serial_executor.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN

void render_paths(const CpuAccel &accel, const SceneView &scene, const PathSettings &settings,
                  const PathUnit &unit, const PathWave &wave, const FilmView &film, uint32_t num_paths,
                  double (*seconds)(), PathKernelCounters &counters)
{
  SerialExecutor executor(accel, seconds, counters);
  trace_paths(executor, scene, settings, unit, wave, film, num_paths);
  for (uint32_t i = 0; i < num_paths; ++i) {
    const float largest = max_component(wave.paths[i].radiance);
    if (largest > counters.largest_sample) counters.largest_sample = largest;
  }
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
