#include "cuda/photon/eye_tracer.h"

#include <algorithm>
#include <bit>

#include "cuda/layout.h"

namespace gpurt::cuda {
namespace {

struct EyeArrays {
  EyeWave wave;
  Hit *hits;
  uint32_t *trace_scratch;
  uint64_t bytes;
};

EyeArrays lay_out(std::byte *base, uint64_t n)
{
  Layout layout(base);
  EyeArrays a{};
  a.wave.states = layout.take<PathState>(n);
  a.wave.points = layout.take<VisiblePoint>(n);
  for (EyeQueue &q : a.wave.queues)
    q = {layout.take<Ray>(n), layout.take<uint32_t>(n), layout.take<uint32_t>(n)};
  a.hits = layout.take<Hit>(n);
  a.wave.hits = a.hits;
  a.wave.shadows.queue = {layout.take<Ray>(n), layout.take<uint32_t>(n), layout.take<Vec3f>(n)};
  a.wave.shadows.left_out = layout.take<uint32_t>(n);
  a.wave.shadows.ended_at = layout.take<uint32_t>(n);
  a.wave.shadows.occluded = layout.take<uint8_t>(n);
  a.wave.numbers = layout.take<EyeNumbers>(1);
  a.trace_scratch = layout.take<uint32_t>(trace_scratch_words(n));
  a.bytes = layout.bytes();
  return a;
}

// A gather's kernels are kept between these: long enough to fill the device, short enough to be cancelled between them.
constexpr double shortest_gather_seconds = 0.01, longest_gather_seconds = 0.04;
constexpr uint32_t largest_first_slice = 1u << 15, smallest_slice = 1u << 6;
// Photons that the points of the first kernel look at, should all lie within their radius: some tens of milliseconds.
constexpr uint64_t first_gather_photons = uint64_t(1) << 33;

}  // namespace

EyeTracer::EyeTracer(PassQueue &queue, uint32_t capacity)
    : queue_(queue), capacity_(capacity), buffer_(queue.memory, lay_out(nullptr, capacity).bytes, "eye paths")
{
  const EyeArrays a = lay_out(buffer_.data(), capacity);
  wave_ = a.wave;
  wave_.scene = queue.scene.scene;
  wave_.leaves_out = queue.has_near();
  hits_ = a.hits;
  trace_scratch_ = a.trace_scratch;
  check(cudaMemsetAsync(wave_.numbers, 0, sizeof *wave_.numbers, queue.stream), "cudaMemsetAsync");
  // What pads the states is read along with them.
  check(cudaMemsetAsync(wave_.states, 0, uint64_t(capacity) * sizeof(PathState), queue.stream),
        "cudaMemsetAsync");
}

const EyeNumbers &EyeTracer::read_numbers()
{
  std::byte *host = queue_.numbers + PassQueue::eye_numbers;
  check(cudaMemcpyAsync(host, wave_.numbers, sizeof(EyeNumbers), cudaMemcpyDeviceToHost, queue_.stream),
        "cudaMemcpyAsync");
  check(cudaStreamSynchronize(queue_.stream), "cudaStreamSynchronize");
  return *reinterpret_cast<const EyeNumbers *>(host);
}

// Before a step counts its rays.
void EyeTracer::clear_step()
{
  check(cudaMemsetAsync(wave_.numbers, 0, offsetof(EyeNumbers, largest_bits), queue_.stream),
        "cudaMemsetAsync");
}

void EyeTracer::clear_points(uint32_t n)
{
  check(cudaMemsetAsync(wave_.points, 0, n * sizeof(VisiblePoint), queue_.stream), "cudaMemsetAsync");
}

void EyeTracer::set_passes(const PhotonPass *passes, uint32_t first_slot)
{
  wave_.passes = passes;
  wave_.first_slot = first_slot;
}

// The shadow rays of the step are done with.
void EyeTracer::pass_near_points(int from, uint32_t depth, uint32_t num_rays)
{
  for (uint32_t k = 0; k < num_near_rays; ++k) {
    launch_aim_near_rays(wave_, from, depth, k, num_rays, queue_.stream);
    queue_.trace_any(wave_.shadows.queue.rays, num_rays, wave_.shadows.occluded, Coherence::Coherent, nullptr,
                     nullptr, trace_scratch_);
    launch_pass_near_points(wave_, from, depth, num_rays, queue_.stream);
  }
  queue_.mark(PhotonLap::Shadow);
}

bool EyeTracer::trace_points(const PathSettings &settings, uint32_t remedies, const EyePixels &pixels,
                             const FilmView &film, uint32_t n)
{
  wave_.settings = settings;
  wave_.pixels = pixels;
  wave_.film = film;
  launch_start_eye_paths(wave_, n, queue_.stream);
  queue_.mark(PhotonLap::Generate);
  uint32_t num_rays = n;
  int from = 0;
  for (uint32_t depth = 1; num_rays != 0; ++depth, from = 1 - from) {
    const EyeQueue &rays = wave_.queues[from];
    const bool is_first = depth == 1;
    queue_.trace(rays.rays, num_rays, hits_, is_first ? Coherence::Coherent : Coherence::Incoherent,
                 is_first ? nullptr : rays.left_out, trace_scratch_);
    queue_.mark(PhotonLap::Trace);
    (is_first ? counters_.num_camera_rays : counters_.num_bounce_rays) += num_rays;
    clear_step();
    launch_shade_eye_paths(wave_, from, depth, num_rays, queue_.stream);
    queue_.mark(PhotonLap::Shade);
    const EyeNumbers numbers = read_numbers();
    if (queue_.is_cancelled()) return false;
    if (numbers.shadows != 0) {
      const EyeShadows &shadows = wave_.shadows;
      queue_.trace_any(shadows.queue.rays, numbers.shadows, shadows.occluded, Coherence::Incoherent,
                       shadows.left_out, shadows.ended_at, trace_scratch_);
      launch_add_direct_light(wave_, numbers.shadows, queue_.stream);
      queue_.mark(PhotonLap::Shadow);
      counters_.num_shadow_rays += numbers.shadows;
    }
    if (remedies & remedy_continue) pass_near_points(from, depth, num_rays);
    num_rays = numbers.next;
  }
  return true;
}

bool EyeTracer::measure_discs(uint32_t remedies, uint32_t n)
{
  if (!(remedies & remedy_boundary)) return true;
  clear_step();
  launch_begin_disc_trials(wave_, n, queue_.stream);
  queue_.mark(PhotonLap::Generate);
  uint32_t num_points = read_numbers().next;
  int from = 0;
  for (DiscTrials trials{0, 1}; num_points != 0;) {
    const uint32_t num_rays = num_points * trials.per_point;
    // Short rays, from places that lie together.
    queue_.trace(wave_.queues[from].rays, num_rays, hits_, Coherence::Coherent, nullptr, trace_scratch_);
    queue_.mark(PhotonLap::Trace);
    clear_step();
    launch_end_disc_trials(wave_, from, trials, num_points, queue_.stream);
    queue_.mark(PhotonLap::Shade);
    num_points = read_numbers().next;
    if (queue_.is_cancelled()) return false;
    from = 1 - from;
    if (num_points == 0) break;
    // As many again as there were so far, if they find room.
    trials.first += trials.per_point;
    trials.per_point =
        std::min({trials.first, max_disc_trials - trials.first, std::max(capacity_ / num_points, 1u)});
    launch_aim_disc_trials(wave_, from, trials, num_points, queue_.stream);
    queue_.mark(PhotonLap::Generate);
  }
  return true;
}

void EyeTracer::set_radii(const FilmView &film, uint32_t n)
{
  wave_.film = film;
  launch_set_photon_radii(wave_, n, queue_.stream);
  queue_.mark(PhotonLap::Generate);
}

bool EyeTracer::gather(const PhotonGrid &grid, const PhotonSums &sums, uint32_t n)
{
  if (grid.num_photons == 0) return true;
  if (gather_slice_ == 0) {
    gather_slice_ = uint32_t(
        std::clamp<uint64_t>(first_gather_photons / grid.num_photons, smallest_slice, largest_first_slice));
  }
  Event begin, end;
  for (uint32_t first = 0; first < n;) {
    const uint32_t count = std::min(gather_slice_, n - first);
    begin.record(queue_.stream);
    launch_gather_points(wave_, grid, sums, first, count, queue_.stream);
    end.record(queue_.stream);
    first += count;
    // Where a slice is all, or the last one, the next step waits for it.
    if (first == n && count < gather_slice_) break;
    end.wait();
    if (queue_.is_cancelled()) return false;
    const double seconds = seconds_between(begin, end);
    if (seconds < shortest_gather_seconds) gather_slice_ = std::min(gather_slice_ * 2, 1u << 30);
    else if (seconds > longest_gather_seconds)
      gather_slice_ = std::max(gather_slice_ / std::bit_ceil(uint32_t(seconds / longest_gather_seconds) + 1),
                               smallest_slice);
  }
  queue_.mark(PhotonLap::Gather);
  return true;
}

void EyeTracer::add_samples(const PhotonSums &sums, const FilmView &film, uint32_t n)
{
  wave_.film = film;
  launch_add_photon_samples(wave_, sums, n, queue_.stream);
  queue_.mark(PhotonLap::Film);
}

EyeTracer::Counters EyeTracer::take_counters()
{
  const EyeNumbers numbers = read_numbers();
  check(cudaMemsetAsync(wave_.numbers, 0, sizeof *wave_.numbers, queue_.stream), "cudaMemsetAsync");
  Counters c = counters_;
  counters_ = {};
  c.num_bounce_rays += numbers.num_probes;
  c.num_shadow_rays += numbers.num_near_rays;
  c.num_gathered = numbers.num_gathered;
  c.num_visible = numbers.num_visible;
  c.largest_sample = float_from_bits(numbers.largest_bits);
  return c;
}

}  // namespace gpurt::cuda
