#include "cpu/photon/scene_photons.h"

#include <tbb/parallel_for.h>

#include <algorithm>

#include "cpu/photon/photon_map.h"
#include "cpu/photon/photon_store.h"

namespace gpurt {

std::shared_ptr<const PhotonMap> photon_map_on_cpu(const PathSettings &settings, const EmissionView &emission,
                                                   const ScenePhotonRequest &asked,
                                                   const CpuPhotonScene &scene,
                                                   const std::shared_ptr<tbb::task_arena> &arena)
{
  TrackedArray<Photon> records;
  scene.arena.execute([&] {
    const PhotonRequest request{{asked.num_paths, 1, PhotonKernel::Constant, 0}, emission};
    RenderPass pass;
    pass.settings = settings;
    pass.photon = &request;
    const PhotonPass photon_pass = make_photon_pass(request.settings, emission, asked.pass);
    PhotonStore store(pass, photon_pass, scene);
    std::vector<PhotonStore::Chunk> chunks;
    std::vector<uint64_t> places;
    uint64_t num_photons = 0;
    while (!store.is_last()) {
      for (PhotonStore::Chunk &chunk : store.trace_some()) {
        places.push_back(num_photons);
        num_photons += chunk.size();
        chunks.push_back(std::move(chunk));
      }
    }
    records = {scene.memory, num_photons, "photons"};
    // Chunks come in the order of paths, but each is what bounce after bounce left.
    tbb::parallel_for(size_t(0), chunks.size(), [&](size_t k) {
      Photon *const first = records.data() + places[k];
      Photon *const end = std::copy_n(chunks[k].data(), chunks[k].size(), first);
      chunks[k].free();
      std::sort(first, end, [](const Photon &a, const Photon &b) {
        return a.id != b.id ? a.id < b.id : a.bounce < b.bounce;
      });
    });
  });
  return std::make_shared<CpuPhotonMap>(map_request(asked, emission, records.data(), records.size()), arena,
                                        scene.memory);
}

}  // namespace gpurt
