// gpurt_photon_settings and gpurt_photon_counters from and to the library's own types.
#pragma once

#include "gpurt.h"
#include "photon_pass.h"

namespace gpurt {

inline gpurt_photon_settings describe(const PhotonSettings &s)
{
  gpurt_photon_settings d = GPURT_PHOTON_SETTINGS_INIT;
  if (s.photons_per_pass == 0) return d;  // of another pipeline
  d.photons_per_pass = s.photons_per_pass;
  d.initial_radius = s.initial_radius;
  d.estimator = gpurt_photon_estimator(s.estimator);
  d.kernel = gpurt_photon_kernel(s.kernel);
  d.remedies = s.remedies != 0 ? s.remedies : uint32_t(GPURT_PHOTON_REMEDY_NONE);
  return d;
}

inline gpurt_photon_counters describe(const PhotonCounters &c)
{
  gpurt_photon_counters d = GPURT_PHOTON_COUNTERS_INIT;
  d.num_emitted = c.num_emitted;
  d.num_rays = c.num_rays;
  d.num_stored = c.num_stored;
  d.num_gathered = c.num_gathered;
  d.num_visible = c.num_visible;
  d.num_sub_passes = c.num_sub_passes;
  d.trace_seconds = c.trace_seconds;
  d.build_seconds = c.build_seconds;
  d.gather_seconds = c.gather_seconds;
  d.smallest_radius = c.smallest_radius;
  d.emit_seconds = c.emit_seconds;
  d.scatter_seconds = c.scatter_seconds;
  return d;
}

}  // namespace gpurt
