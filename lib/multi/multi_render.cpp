// A pass on several devices: they draw its units from one queue. Film sums are exact, so it does not matter who renders
// what.
#include <atomic>

#include "error.h"
#include "multi/multi_scene.h"
#include "multi/shared_work.h"

namespace gpurt::multi {
namespace {

// Workers of a device: while the last paths of one part run out, the next part fills the device.
constexpr size_t workers_per_member = 2;
// What a part has at least for each thread, or multiprocessor, of a device: about what a multiprocessor can hold.
constexpr uint64_t min_paths_per_thread = 2048;

}  // namespace

MultiScene::MultiScene(std::shared_ptr<const Members> members,
                       std::vector<std::shared_ptr<const CommittedScene>> scenes)
    : members_(std::move(members)), scenes_(std::move(scenes)), facts_(scenes_[0]->accel_facts())
{
  for (size_t i = 1; i < scenes_.size(); ++i) facts_.accel_bytes += scenes_[i]->accel_facts().accel_bytes;
}

HostKdTree MultiScene::export_tree(uint32_t tree) const { return scenes_[0]->export_tree(tree); }

void MultiScene::render(const RenderPass &pass) const
{
  if (pass.photon != nullptr) return render_photons(pass);
  uint64_t smallest = 0;
  for (const auto &backend : members_->backends)
    smallest = std::max(smallest, min_paths_per_thread * backend->info().num_threads);
  SharedUnits queue(pass.units, scenes_.size(), workers_per_member, smallest);
  std::atomic<bool> stop{false};
  const auto is_cancelled = [&] {
    return pass.cancelled != nullptr && pass.cancelled->load(std::memory_order_relaxed);
  };

  const auto work = [&](size_t member) {
    std::atomic<bool> has_begun{false};  // has delivered, or drawn more than the part that it was given
    RenderPass part;
    part.settings = pass.settings;
    part.outputs = pass.outputs;
    part.schedule = pass.schedule;
    part.reyes = pass.reyes;
    part.reyes_schedule = pass.reyes_schedule;
    part.cancelled = pass.cancelled;
    part.deliver = [&](const WorkUnit &unit, const TileFilm &film, const RenderCounters &counters) {
      has_begun = true;
      pass.deliver(unit, film, counters);
    };
    part.more = [&]() -> std::span<const WorkUnit> {
      if (stop || is_cancelled()) return {};
      has_begun = true;
      return queue.take_more();
    };
    while (!stop && !is_cancelled()) {
      part.units = queue.take(member);
      if (part.units.empty()) return;
      has_begun = false;
      try {
        run_named(*members_, member, [&] { scenes_[member]->render(part); });
      } catch (const Error &e) {
        // Where memory is too short for two parts at a time, the device goes on with one.
        if (e.result() == GPURT_ERROR_OUT_OF_MEMORY && !has_begun && queue.give_back(member, part.units))
          return;
        stop = true;
        throw;
      } catch (...) {
        stop = true;
        throw;
      }
    }
  };
  // The first workers of all devices come first, so that a pass of few parts reaches every device.
  run_side_by_side(scenes_.size() * workers_per_member, [&](size_t i) { work(i % scenes_.size()); });
}

}  // namespace gpurt::multi
