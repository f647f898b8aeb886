// Kernels of films in device memory.
#pragma once

#include <cuda_runtime_api.h>

#include "core/path/film_values.h"

namespace gpurt::cuda {

struct FilmFindings {
  unsigned long long num_nonfinite, num_saturated;
};

/// Adds a group's film at (x0, y0) of `film` and counts what that finds, from what `found` has. `group` may be the film itself, with
/// all of its pixels: then it counts alone.
void launch_add_group(const FilmView &film, const FilmView &group, uint32_t x0, uint32_t y0,
                      FilmFindings *found, cudaStream_t stream);

/// Values of an output of pixels first .. first + num_pixels - 1, one behind the other. `values` may be memory of the host that
/// the device reaches.
void launch_resolve(const FilmView &film, FilmOutput output, uint64_t first, uint64_t num_pixels,
                    uint32_t *values, cudaStream_t stream);

}  // namespace gpurt::cuda
