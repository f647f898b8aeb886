// Frames whose sums are on the device that renders them. Passes add to them there, and what readers ask for is resolved there;
// the host's arrays are brought up to date where somebody needs the sums themselves: to save, to merge, to estimate the error.
//
// While the device's film is newer, the host's arrays are what the frame was when the two were last equal. That is what it goes
// back to where the device is lost.
#include <chrono>

#include "frame/frame.h"

namespace gpurt {

namespace {

// Sums go to the host once rendering them took so many times as long as copying them does: losing them costs some tenths of a
// second for large frames, and the copies little beside what is rendered meanwhile. Small ones go at once.
constexpr double securing_share = 30;
constexpr double copied_bytes_per_second = 1e10;  // into memory that is not page-locked
constexpr uint64_t small_bytes = uint64_t(1) << 20;

}  // namespace

std::unique_ptr<DeviceFilm> Frame::make_device_film() const
{
  return scene_.committed->make_film(state_.settings.width, state_.settings.height, state_.settings.outputs);
}

void Frame::make_host_arrays() const
{
  state_.film.clear();
  state_.sample_sets.assign(state_.film.pixels.size(), SampleSets::empty);
  has_host_arrays_ = true;
}

bool Frame::take_to_device()
{
  if (!keeps_on_device_) return false;
  const std::scoped_lock lock(host_mutex_, device_mutex_);
  if (on_device_.film && on_device_.has_samples) return true;
  on_device_ = {};
  OnDevice taken;
  taken.film = make_device_film();
  taken.sets = PixelSets(state_.settings.width, state_.settings.height);
  if (has_host_arrays_) {
    taken.sets.assign(state_.sample_sets);
    taken.has_samples = !taken.sets.has_one_set() || taken.sets.of(0) != SampleSets::empty;
  }
  if (taken.has_samples) {
    try {
      taken.film->upload(state_.film);
    } catch (const gpurt::Error &e) {
      if (e.result() != GPURT_ERROR_OUT_OF_MEMORY) throw;
      return false;
    }
  }
  on_device_ = std::move(taken);
  return true;
}

void Frame::leave_device()
{
  const std::unique_lock<std::mutex> host_lock = host_sums();
  if (!host_lock) return;
  const std::scoped_lock lock(device_mutex_);
  on_device_ = {};
}

std::unique_lock<std::mutex> Frame::host_sums() const
{
  if (!keeps_on_device_) return {};
  std::unique_lock<std::mutex> host_lock(host_mutex_);
  const std::scoped_lock lock(device_mutex_);
  if (on_device_.is_newer) bring_to_host();
  if (!has_host_arrays_) make_host_arrays();
  return host_lock;
}

void Frame::bring_to_host() const
{
  bool has_begun = false;
  try {
    on_device_.film->download(state_.film, has_begun);
  } catch (const gpurt::Error &e) {
    if (e.result() == GPURT_ERROR_DEVICE) go_back_to_host(e, has_begun);
    throw;
  }
  settle_sets();
  on_device_.sets.copy_to(state_.sample_sets);
  has_host_arrays_ = true;
  on_device_.is_newer = false;
}

void Frame::go_back_to_host(const gpurt::Error &loss, bool has_begun) const
{
  uint64_t num_samples = 0;
  {
    const std::scoped_lock lock(totals_mutex_);
    FrameTotals &t = state_.totals;
    const FrameTotals &before = on_device_.host_totals;
    // What was half overwritten is of no use.
    if (has_begun) has_host_arrays_ = false;
    t.counters = has_host_arrays_ ? before.counters : RenderCounters{};
    t.num_saturated = has_host_arrays_ ? before.num_saturated : 0;
    t.render_seconds = has_host_arrays_ ? before.render_seconds : 0;
    num_samples = t.counters.num_samples;
    generation_++;
  }
  on_device_ = {};
  fail(GPURT_ERROR_DEVICE,
       "{}. The frame's last samples were there: it goes back to the {} that the host has, with which calls "
       "go on from now",
       loss.what(), num_samples);
}

void Frame::settle_sets() const
{
  on_device_.sets.settle([&](uint32_t set, const SampleRange &range) {
    const std::scoped_lock lock(sets_mutex_);
    return state_.sets.unite(set, {&range, 1});
  });
}

PixelSets Frame::pixel_sets() const
{
  {
    const std::scoped_lock lock(device_mutex_);
    if (on_device_.film) {
      settle_sets();
      return on_device_.sets;
    }
  }
  PixelSets sets(state_.settings.width, state_.settings.height);
  sets.assign(state_.sample_sets);
  return sets;
}

bool Frame::read_on_device(gpurt_output output, void *data, uint64_t size_bytes) const
{
  check_read(output, data, size_bytes);
  if (!keeps_on_device_) return false;
  const std::scoped_lock lock(device_mutex_);
  if (!on_device_.film || !on_device_.has_samples) return false;
  try {
    return on_device_.film->resolve(output, data, size_bytes);
  } catch (const gpurt::Error &e) {
    // Where the device is lost, the host may have all that it had; it says so where it has not.
    if (e.result() == GPURT_ERROR_INVALID_ARGUMENT) throw;
    return false;
  }
}

void Frame::add_on_device(std::span<const WorkUnit> units, const RenderCounters &counters,
                          const std::function<FilmFinds()> &add)
{
  const std::scoped_lock lock(device_mutex_);
  const auto start = std::chrono::steady_clock::now();
  OnDevice &d = on_device_;
  if (!d.is_newer) {
    d.host_totals = totals();
    d.newer_seconds = 0;
  }
  const FilmFinds found = add();
  d.has_samples = d.is_newer = true;
  d.sets.add(units);
  if (d.sets.is_full()) settle_sets();
  RenderCounters counted = counters;
  counted.num_nonfinite = found.num_nonfinite;  // the film knows best
  counted.film_seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const std::scoped_lock totals_lock(totals_mutex_);
  add_counters(state_.totals.counters, counted);
  state_.totals.num_saturated += found.num_saturated;
  generation_++;
}

void Frame::secure_on_host(double seconds)
{
  if (!keeps_on_device_) return;
  // A job does not wait for whoever saves the frame; there is a next pass, or a next job.
  const std::unique_lock<std::mutex> host_lock(host_mutex_, std::try_to_lock);
  const std::scoped_lock lock(device_mutex_);
  if (!on_device_.is_newer) return;
  on_device_.newer_seconds += seconds;
  const uint64_t bytes = state_.film.bytes();
  if (host_lock && (bytes <= small_bytes ||
                    on_device_.newer_seconds * copied_bytes_per_second >= securing_share * double(bytes)))
    bring_to_host();
}

FrameTotals Frame::host_totals() const
{
  const std::scoped_lock lock(device_mutex_);
  return on_device_.is_newer ? on_device_.host_totals : totals();
}

}  // namespace gpurt
