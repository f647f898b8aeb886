/* gpurt for CUDA callers: work on the caller's stream, between the caller's events.
 *
 * Needs no CUDA header. Streams are cudaStream_t or CUstream, events are cudaEvent_t or CUevent, passed as void *; they
 * belong to the context of the device. On other devices the functions return GPURT_ERROR_UNSUPPORTED.
 */
#ifndef GPURT_CUDA_H
#define GPURT_CUDA_H

#include "gpurt.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Queues a batch of rays on a stream and returns before it is done.
 *
 *  @param desc        As for gpurt_scene_trace, with storage GPURT_STORAGE_DEVICE. Its arrays are device memory and stay
 *                     valid until the work is done; the descriptor itself may go at once.
 *  @param stream      The stream; NULL is the default stream.
 *  @param wait_event  The work starts after this event; NULL: when the stream reaches it.
 *  @param done_event  Recorded after the work; NULL: none.
 *
 *  The scene must neither be released nor committed before the work is done.
 *  Errors: as gpurt_scene_trace; UNSUPPORTED where the device, the query or the schedule does not work on streams, and
 *  for out_counters, which only the end of the work can tell. Failures of the work
 *  itself show in the stream.
 */
GPURT_API gpurt_result gpurt_cuda_trace(gpurt_scene scene, const gpurt_trace_desc *desc, void *stream,
                                        void *wait_event, void *done_event);

/** Queues a batch of queries of a photon map on a stream and returns before it is done.
 *
 *  @param desc        As for gpurt_photon_map_query, with storage GPURT_STORAGE_DEVICE. Its arrays stay valid until the
 *                     work is done; the descriptor itself may go at once.
 *  @param stream, wait_event, done_event  As for gpurt_cuda_trace.
 *
 *  The map must not be released before the work is done.
 *  Errors: as gpurt_photon_map_query; UNSUPPORTED where the device does not work on streams, and for LIST, whose offsets
 *  only the end of the work can tell. Failures of the work itself show in the stream.
 */
GPURT_API gpurt_result gpurt_cuda_query_photons(gpurt_photon_map map, const gpurt_photon_query_desc *desc,
                                                void *stream, void *wait_event, void *done_event);

/** Makes what is queued on `stream` from now on wait for what is on the stream `after` now; returns at once.
 *
 *  @param ordinal  Which CUDA device of `device` the streams belong to.
 *
 *  NULL is the default stream; the special handles of CUDA, 1 (legacy default) and 2 (per-thread), work too. With this, a
 *  caller that has no CUDA runtime of its own can keep the stream protocol of DLPack.
 *  Errors: INVALID_ARGUMENT for an ordinal that the device has not; UNSUPPORTED; DEVICE.
 */
GPURT_API gpurt_result gpurt_cuda_order(gpurt_device device, uint32_t ordinal, void *stream, void *after);

/** Waits until what is on the stream now is done. Errors: as gpurt_cuda_order, and failures of that work. */
GPURT_API gpurt_result gpurt_cuda_wait(gpurt_device device, uint32_t ordinal, void *stream);

/** A kernel, as it runs on a device. */
typedef struct gpurt_cuda_kernel {
  char name[96];                      /* what it does; kernels for different scenes may share a name */
  uint64_t num_launches;              /* by this process so far */
  uint32_t block_threads;             /* threads of a block */
  uint32_t registers;                 /* of a thread */
  uint32_t local_bytes;               /* of a thread: stacks, and registers that found no room */
  uint32_t shared_bytes;              /* of a block */
  uint32_t blocks_per_multiprocessor; /* that are resident at once */
  float occupancy;                    /* share of a multiprocessor's threads that these are */
} gpurt_cuda_kernel;

/** Lists the kernels that this process has launched, in the order of their first launch.
 *
 *  @param device     A CUDA device, whose figures are given.
 *  @param kernels    [capacity] array, or NULL to count.
 *  @param out_count  Number of kernels, also when it exceeds capacity.
 *
 *  Errors: INVALID_ARGUMENT; UNSUPPORTED for other devices; DEVICE.
 */
GPURT_API gpurt_result gpurt_cuda_get_kernels(gpurt_device device, gpurt_cuda_kernel *kernels,
                                              uint32_t capacity, uint32_t *out_count);

#ifdef __cplusplus
}
#endif
#endif
