// The path pipeline's stages as kernels, and the executor that starts them on a stream.
#include "cuda/launch.h"
#include "cuda/path/wave.h"

namespace gpurt::cuda {
namespace {

// The generic kernel of per-item stages.
template <class Stage>
__global__ void __launch_bounds__(block_size) run_stage(const __grid_constant__ Stage stage, uint32_t n)
{
  const uint64_t i = thread_item();
  if (i < n) stage(uint32_t(i));
}

// The bits of positive floats are ordered as the floats; what is not a number is not above 0.
struct FindLargestSample {
  const PathState *paths;
  uint32_t *largest_bits;

  __device__ void operator()(uint32_t i) const
  {
    const float largest = max_component(paths[i].radiance);
    // Most paths see that they are not the largest without an atomic operation.
    if (largest > 0.0f && float_bits(largest) > *largest_bits) atomicMax(largest_bits, float_bits(largest));
  }
};

constexpr const char *stage_names[] = {"path stage 'generate'", "path stage 'trace'", "path stage 'shade'",
                                       "path stage 'shadow'", "path stage 'film'"};

class StreamExecutor {
 public:
  StreamExecutor(const TraceScene &scene, const std::atomic<bool> *cancelled, WaveMemory &memory,
                 cudaStream_t stream, WaveCounters &counters)
      : scene_(scene), cancelled_(cancelled), memory_(memory), stream_(stream), counters_(counters)
  {
    memory_.clock.start(stream_);
  }

  template <class Stage>
  void for_each(PathStage id, uint32_t n, const Stage &stage)
  {
    launch(stage_names[uint32_t(id)], run_stage<Stage>, n, stream_, stage, n);
    memory_.clock.mark(stream_, id);
  }

  void trace_closest(const Ray *rays, Hit *hits, uint32_t n)
  {
    launch_closest(scene_, rays, n, HitLayout::Internal, hits, stream_);
    (is_first_trace_ ? counters_.num_camera_rays : counters_.num_bounce_rays) += n;
    is_first_trace_ = false;
    memory_.clock.mark(stream_, PathStage::Trace);
  }

  void trace_occluded(const Ray *rays, uint8_t *occluded, uint32_t n)
  {
    launch_any(scene_, rays, n, occluded, stream_);
    counters_.num_shadow_rays += n;
    memory_.clock.mark(stream_, PathStage::Shadow);
  }

  uint32_t compact_rays(const RayQueue &from, uint32_t n, const RayQueue &to)
  {
    launch_compact_rays(from, n, to, memory_.compaction(), stream_);
    return kept();
  }

  uint32_t compact_shadows(const ShadowQueue &from, uint32_t n, const ShadowQueue &to)
  {
    launch_compact_shadows(from, n, to, memory_.compaction(), stream_);
    return kept();
  }

  bool was_cancelled() const { return was_cancelled_; }

 private:
  // Waits for a compaction. Cancelled: none are kept, and the paths end here.
  uint32_t kept()
  {
    check(cudaStreamSynchronize(stream_), "cudaStreamSynchronize");
    if (cancelled_ != nullptr && cancelled_->load(std::memory_order_relaxed)) was_cancelled_ = true;
    return was_cancelled_ ? 0 : *memory_.compaction().total;
  }

  const TraceScene &scene_;
  const std::atomic<bool> *cancelled_;
  WaveMemory &memory_;
  cudaStream_t stream_;
  WaveCounters &counters_;
  bool is_first_trace_ = true;
  bool was_cancelled_ = false;
};

}  // namespace

bool render_wave(const TraceScene &scene, const PathSettings &settings, const PathUnit &unit,
                 const FilmView &film, uint32_t num_paths, const std::atomic<bool> *cancelled,
                 WaveMemory &memory, cudaStream_t stream, WaveCounters &counters)
{
  StreamExecutor executor(scene, cancelled, memory, stream, counters);
  trace_paths(executor, scene.scene, settings, unit, memory.wave(), film, num_paths);
  if (executor.was_cancelled()) return false;

  check(cudaMemsetAsync(memory.largest_bits(), 0, sizeof(uint32_t), stream), "cudaMemsetAsync");
  executor.for_each(PathStage::Film, num_paths,
                    FindLargestSample{memory.wave().paths, memory.largest_bits()});
  uint32_t *largest = memory.host_numbers() + 1;
  check(cudaMemcpyAsync(largest, memory.largest_bits(), sizeof(uint32_t), cudaMemcpyDeviceToHost, stream),
        "cudaMemcpyAsync");
  check(cudaStreamSynchronize(stream), "cudaStreamSynchronize");
  memory.clock.collect(counters.stage_seconds);
  counters.largest_sample = max(counters.largest_sample, float_from_bits(*largest));
  return true;
}

}  // namespace gpurt::cuda
