// From hits on the triangles of patches back to the patches.
#pragma once

#include "scene/compiled_scene.h"

namespace gpurt {

/// A batch of hits, records of gpurt_scene_trace, and the arrays to fill.
struct LocateRequest {
  uint64_t num_hits = 0;
  const void *hits = nullptr;
  bool compact = false;
  uint32_t geometry = 0, instance = 0;  // of compact records
  gpurt_patch_point *points = nullptr;
  float *positions = nullptr, *normals = nullptr;  // null: not wanted
};

/// Throws INVALID_ARGUMENT naming the first hit that lies on no patch; nothing is written then.
void locate_on_patches(const CompiledScene &scene, const LocateRequest &request);

}  // namespace gpurt
