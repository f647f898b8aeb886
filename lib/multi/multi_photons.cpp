// Passes of photon mapping on several devices: each takes passes of its own, so that no photon is traced twice. A unit is
// delivered once all devices have done their samples of it; film sums are exact, so it does not matter who did which.
#include <map>
#include <mutex>

#include "multi/multi_scene.h"
#include "render_counters.h"

namespace gpurt::multi {
namespace {

// A unit that waits for devices.
struct WaitingUnit {
  WorkUnit unit;
  std::mutex mutex;
  uint64_t num_samples = 0;  // that have come
  TileFilm film;
  RenderCounters counters;
};

class WaitingUnits {
 public:
  explicit WaitingUnits(const RenderPass &pass) : pass_(pass)
  {
    for (const WorkUnit &u : pass.units) units_[{u.x0, u.y0}].unit = u;
  }

  /// The samples of all units that are those of a member.
  std::vector<WorkUnit> share(size_t member, size_t num_members) const
  {
    std::vector<WorkUnit> units;
    for (WorkUnit u : pass_.units) {
      const uint64_t begin = u.num_samples * member / num_members;
      const uint64_t end = u.num_samples * (member + 1) / num_members;
      if (begin == end) continue;
      u.first_sample += begin;
      u.num_samples = end - begin;
      units.push_back(u);
    }
    return units;
  }

  void take(const WorkUnit &part, const TileFilm &film, const RenderCounters &counters)
  {
    WaitingUnit &waiting = units_.at({part.x0, part.y0});
    const std::lock_guard lock(waiting.mutex);
    if (waiting.num_samples == 0) waiting.film = film;
    else add_film(waiting.film, film, 0, 0);
    add_counters(waiting.counters, counters);
    waiting.num_samples += part.num_samples;
    if (waiting.num_samples != waiting.unit.num_samples) return;
    pass_.deliver(waiting.unit, waiting.film, waiting.counters);
    waiting.film = {};
  }

 private:
  const RenderPass &pass_;
  // No pixel is in two units of a pass, so a corner tells which it is.
  std::map<std::pair<uint32_t, uint32_t>, WaitingUnit> units_;
};

}  // namespace

PhotonPilot MultiScene::photon_pilot(const PathSettings &settings, const EmissionView &emission,
                                     uint32_t num_paths, uint32_t points_per_axis,
                                     const TakePilotPhotons &take) const
{
  PhotonPilot pilot;
  run_named(*members_, 0,
            [&] { pilot = scenes_[0]->photon_pilot(settings, emission, num_paths, points_per_axis, take); });
  return pilot;
}

// Maps lie on the first device, as those of the caller's points do.
std::shared_ptr<const PhotonMap> MultiScene::photon_map(const PathSettings &settings,
                                                        const EmissionView &emission,
                                                        const ScenePhotonRequest &request) const
{
  std::shared_ptr<const PhotonMap> map;
  run_named(*members_, 0, [&] { map = scenes_[0]->photon_map(settings, emission, request); });
  return map;
}

void MultiScene::render_photons(const RenderPass &pass) const
{
  WaitingUnits units(pass);
  run_side_by_side(scenes_.size(), [&](size_t member) {
    const std::vector<WorkUnit> share = units.share(member, scenes_.size());
    if (share.empty()) return;
    RenderPass part = pass;
    part.units = share;
    part.deliver = [&](const WorkUnit &unit, const TileFilm &film, const RenderCounters &counters) {
      units.take(unit, film, counters);
    };
    run_named(*members_, member, [&] { scenes_[member]->render(part); });
  });
}

}  // namespace gpurt::multi
