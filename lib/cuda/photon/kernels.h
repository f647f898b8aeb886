// What the kernels of photon maps do, for host code: each function queues work on a stream. Sizes are checked by callers.
#pragma once

#include <cuda_runtime_api.h>

#include "core/photon/node_lists.h"
#include "core/photon/photon_source.h"
#include "cuda/photon/device_bounds.h"

namespace gpurt::cuda {

/// What looking through points finds, in device memory.
struct DevicePointsFound {
  DeviceBounds bounds;                          // of those that are finite
  uint32_t bad_position, bad_flux, bad_normal;  // the first index; invalid_id: none
};
/// `packed`, if not null, gets the records of a source that has none: what is moved later then lies in one sector, not three.
/// Those of points that are not allowed have no meaning.
void launch_look_through(const PhotonSource &source, DevicePointsFound *found, Photon *packed,
                         cudaStream_t stream);

/// How the points of a grid fill its table.
struct DeviceFill {
  unsigned long long sum_of_squares;
  uint32_t fullest;
};
void launch_fill(const uint32_t *starts, uint32_t table_size, DeviceFill *fill, cudaStream_t stream);

/// The arrays of a grid to be built; those not wanted are null. Fluxes and rests are wanted of records alone.
struct GridTarget {
  uint32_t *starts;
  PhotonProbe *probes;
  PhotonRest *rests;
  uint32_t *indices;
  bool ids_for_fluxes;  // the index in place of the flux
};
/// Working memory of a build. With several slots the records are those of photons in flight (flight.h), and the table has
/// the entries of one slot after the other.
uint64_t grid_build_bytes(const GridShape &shape, uint64_t num_photons, uint32_t num_slots = 1);
void launch_build_grid(const GridShape &shape, const PhotonSource &source, const GridTarget &target,
                       void *memory, cudaStream_t stream, uint32_t num_slots = 1);

/// The records of a grid's points, in the order of their indices.
void launch_read_grid(const PhotonGrid &grid, bool has_fluxes, Photon *records, cudaStream_t stream);

/// Records as they came, into to[n] by (path, bounce). n and num_paths are at most max_photons.
uint64_t record_order_bytes(uint64_t n);
void launch_order_records(const Photon *from, uint64_t n, uint32_t num_paths, void *memory, Photon *to,
                          cudaStream_t stream);

/// Indices of queries, by the cells that they lie in; null where the memory is null: unsorted.
uint64_t query_order_bytes(uint64_t num_queries);
const uint32_t *launch_query_order(const GridShape &shape, const Vec3f *positions, uint32_t num_queries,
                                   void *memory, uint64_t memory_bytes, cudaStream_t stream);

/// Some of the queries of a batch, in device memory; arrays that are not wanted are null.
struct DeviceGather {
  RangeQuery range;
  const Vec3f *positions, *normals;
  const uint32_t *order;  // null: as they are
  uint32_t num_queries;
  uint32_t *counts;
  Vec3f *sums;
  const uint64_t *offsets;  // of each query's list, less first_listed
  uint64_t first_listed;
  uint32_t *ids;
  float *distances;
};
void launch_count(const PhotonGrid &grid, const DeviceGather &gather, cudaStream_t stream);
void launch_sum(const PhotonGrid &grid, const DeviceGather &gather, cudaStream_t stream);
void launch_list(const PhotonGrid &grid, const DeviceGather &gather, cudaStream_t stream);

/// Counts, sums and lists, whatever it has arrays for.
void launch_gather_lists(const ListGather &gather, uint64_t num_queries, cudaStream_t stream);

/// offsets[n + 1] = first + sums of counts[n].
uint64_t offsets_bytes(uint32_t n);
void launch_offsets(const uint32_t *counts, uint32_t n, uint64_t first, uint64_t *offsets, void *memory,
                    uint64_t memory_bytes, cudaStream_t stream);

struct DeviceNearest {
  const Vec3f *positions;
  const uint32_t *order;
  uint32_t num_queries;
  uint32_t k;
  float limit, hint;
  uint32_t *counts, *ids;
  float *distances;
};
void launch_nearest(const PhotonLevels &levels, const DeviceNearest &nearest, cudaStream_t stream);

}  // namespace gpurt::cuda
