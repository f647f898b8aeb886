// Rays that graze: they meet triangles by rounding alone, and pass the plane of these far from them. Which triangle is hit, and
// where, does not depend on the tree, on who built it, or on the kernels that a batch is traced by.
#include "../support/queries.h"
#include "../support/rays.h"
#include "gpurt_cuda.h"
#include "kernel_launches.h"
#include "scenes.h"

namespace gpurt_test {
namespace {

// Enough for CUDA devices to trace by warps that refill, when asked to.
constexpr size_t large_batch = (size_t(1) << 18) + 1000;

std::vector<gpurt_ray> grazing_rays(const Mesh &mesh)
{
  RaySource source(mesh, {}, 5);
  std::vector<gpurt_ray> rays;
  const size_t num_rays = amount(20'000, 1'500);
  for (size_t i = 0; i < num_rays; ++i) {
    rays.push_back(source(i % 4 == 0 ? RayKind::Vertex : i % 4 == 1 ? RayKind::Edge : RayKind::Grazing));
    if (i % 32 == 2) rays.back().tmax = float(uniform(source.rng(), 0.5, 2.0));
  }
  return rays;
}

Scene make_scene(gpurt_device device, const Mesh &mesh, gpurt_accel accel, gpurt_build_quality quality)
{
  Scene scene;
  GPURT_EXPECT_OK(gpurt_scene_create(device, scene.out()));
  add_mesh(scene, mesh);
  gpurt_build_desc desc = GPURT_BUILD_DESC_INIT;
  desc.accel = accel;
  desc.quality = quality;
  GPURT_EXPECT_OK(gpurt_scene_commit(scene, &desc));
  return scene;
}

// Hits of `rays`, again and again where `count` is more, are those of one after another of `expected`.
void expect_hits(gpurt_scene scene, const std::vector<gpurt_ray> &rays, size_t count,
                 gpurt_coherence coherence, const std::vector<gpurt_hit> &expected)
{
  std::vector<gpurt_ray> batch(count);
  for (size_t i = 0; i < count; ++i) batch[i] = rays[i % rays.size()];
  const std::vector<gpurt_hit> hits = trace_closest(scene, batch, coherence);
  const std::vector<uint8_t> occluded = trace_any(scene, batch, coherence);
  size_t num_different = 0;
  for (size_t i = 0; i < count; ++i) {
    const gpurt_hit &e = expected[i % rays.size()];
    if (std::memcmp(&hits[i], &e, sizeof e) == 0 && occluded[i] == uint8_t(e.primitive != GPURT_INVALID_ID))
      continue;
    if (++num_different > 4) continue;
    ADD_FAILURE() << "ray " << i % rays.size() << " of " << count << ", coherence " << coherence << ": t "
                  << hits[i].t << " primitive " << int(hits[i].primitive) << ", any " << int(occluded[i])
                  << "; expected t " << e.t << " primitive " << int(e.primitive);
  }
  EXPECT_EQ(num_different, 0u) << count << " rays, coherence " << coherence;
}

// Hits of warps that refill, however many rays there are. Without being told to, these trace large batches alone, and none whose
// launches would be short since the device was slow before.
void expect_hits_of_refilling_warps(gpurt_device device, gpurt_scene scene,
                                    const std::vector<gpurt_ray> &rays,
                                    const std::vector<gpurt_hit> &expected)
{
  const uint64_t num_finished = launches_of(device, "kernel that finishes closest hits");
  std::vector<gpurt_hit> hits(rays.size());
  gpurt_trace_desc desc = by_refilling_warps(rays);
  desc.hits = hits.data();
  GPURT_EXPECT_OK(gpurt_scene_trace(scene, &desc));
  size_t num_different = 0;
  for (size_t i = 0; i < rays.size(); ++i)
    num_different += std::memcmp(&hits[i], &expected[i], sizeof hits[i]) != 0;
  EXPECT_EQ(num_different, 0u);
  EXPECT_GT(launches_of(device, "kernel that finishes closest hits"), num_finished);
}

void compare_trees_and_kernels(gpurt_device_type kind)
{
  const Device reference = make_device(GPURT_DEVICE_CPU), device = make_device(kind);
  const bool is_cuda = kind == GPURT_DEVICE_CUDA;
  for (const char *name : {"thin", "needles", "city"}) {
    const Mesh mesh = mesh_of_kind(name).mesh;
    const std::vector<gpurt_ray> rays = grazing_rays(mesh);
    const std::vector<gpurt_hit> expected =
        trace_closest(make_scene(reference, mesh, GPURT_ACCEL_KDTREE, GPURT_BUILD_QUALITY_HIGH), rays);
    size_t num_hits = 0;
    for (const gpurt_hit &hit : expected) num_hits += hit.primitive != GPURT_INVALID_ID;
    EXPECT_GT(num_hits, rays.size() / 4);
    for (const gpurt_accel accel : {GPURT_ACCEL_KDTREE, GPURT_ACCEL_BVH}) {
      for (const gpurt_build_quality quality : {GPURT_BUILD_QUALITY_HIGH, GPURT_BUILD_QUALITY_FAST}) {
        SCOPED_TRACE(std::string(name) + (accel == GPURT_ACCEL_BVH ? ", bvh" : ", kdtree") +
                     (quality == GPURT_BUILD_QUALITY_FAST ? ", fast" : ""));
        const Scene scene = make_scene(device, mesh, accel, quality);
        expect_hits(scene, rays, rays.size(), GPURT_COHERENCE_AUTO, expected);
        if (!is_cuda) continue;
        for (const gpurt_coherence coherence : {GPURT_COHERENCE_COHERENT, GPURT_COHERENCE_INCOHERENT}) {
          if (!is_short_form()) expect_hits(scene, rays, large_batch, coherence, expected);
        }
        expect_hits_of_refilling_warps(device, scene, rays, expected);
      }
    }
  }
}

TEST(CudaGrazing, HitsDependOnNeitherTreeNorKernel)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  compare_trees_and_kernels(GPURT_DEVICE_CUDA);
}

TEST(Grazing, HitsDoNotDependOnTheTree) { compare_trees_and_kernels(GPURT_DEVICE_CPU); }

}  // namespace
}  // namespace gpurt_test
