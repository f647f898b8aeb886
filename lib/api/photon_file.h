// Files that keep photon maps: the points as records, in the order of their ids.
#pragma once

#include <string>
#include <vector>

#include "memory.h"
#include "photon_maps.h"

namespace gpurt::api {

struct PhotonFile {
  Reservation reservation;  // of the records
  std::vector<Photon> records;
  float radius = 0;
  uint32_t num_levels = 1;
  bool has_fluxes = false, has_normals = false;
  float flux_scale = 1;
  uint32_t num_paths = 0;
};

/// Throws IO naming the path and the reason; what was at `path` before then stays.
void write_photon_file(const std::string &path, const PhotonFile &file);

/// Throws IO for a foreign or damaged file; OUT_OF_MEMORY.
PhotonFile read_photon_file(const std::string &path, const std::shared_ptr<MemoryTracker> &memory);

}  // namespace gpurt::api
