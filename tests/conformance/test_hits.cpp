// Closest, any and all hits of the kd-tree and the bvh against exact geometry: rays at edges, vertices, split planes and
// along axes, on meshes of six kinds, through the library's own trees, those that a GPU builds, and kd-trees made by CGAL.
#include <cstring>
#include <optional>

#include "../support/cgal_tree.h"
#include "../support/judge.h"
#include "../support/queries.h"
#include "../support/short_form.h"

namespace {

using namespace gpurt_test;

#if defined(__SANITIZE_ADDRESS__)
constexpr size_t num_rays = 4000;
#else
const size_t num_rays = is_short_form() ? 600 : 100000;
#endif
// A batch that CUDA devices may trace by warps that refill.
constexpr size_t large_batch = (size_t(1) << 18) + 1000;

struct Params {
  std::string kind;
  gpurt_accel accel;
  bool is_cuda;
  bool is_fast;  // trees that are built in the least time: on the device, where that is a GPU
};

std::vector<Params> all_params(bool are_fast)
{
  std::vector<Params> params;
  for (const std::string &kind : mesh_kinds) {
    for (const gpurt_accel accel : {GPURT_ACCEL_KDTREE, GPURT_ACCEL_BVH}) {
      if (!are_fast) params.push_back({kind, accel, false, false});
      params.push_back({kind, accel, true, are_fast});
    }
  }
  return params;
}

class Hits : public ::testing::TestWithParam<Params> {
 protected:
  void SetUp() override
  {
    if (GetParam().is_cuda && !has_cuda()) GTEST_SKIP() << "no CUDA device";
    device_ = make_device(GetParam().is_cuda ? GPURT_DEVICE_CUDA : GPURT_DEVICE_CPU);
    named_ = mesh_of_kind(GetParam().kind);
    ASSERT_EQ(is_closed(named_.mesh), named_.is_closed);
    oracle_.emplace(named_.mesh);
  }

  bool is_kdtree() const { return GetParam().accel == GPURT_ACCEL_KDTREE; }

  Scene make_scene(gpurt_triangle_test test, const ExchangeTree *tree = nullptr)
  {
    return make_scene(GetParam().accel, test, tree);
  }
  Scene make_scene(gpurt_accel accel, gpurt_triangle_test test, const ExchangeTree *tree = nullptr)
  {
    Scene scene;
    GPURT_EXPECT_OK(gpurt_scene_create(device_, scene.out()));
    add_mesh(scene, named_.mesh);
    if (tree != nullptr) {
      gpurt_kdtree desc = GPURT_KDTREE_INIT;
      desc.num_nodes = tree->nodes.size();
      desc.num_references = tree->references.size();
      desc.num_triangles = named_.mesh.triangles.size();
      std::copy_n(tree->bounds.lo.begin(), 3, desc.bounds_min);
      std::copy_n(tree->bounds.hi.begin(), 3, desc.bounds_max);
      desc.nodes = const_cast<gpurt_kdtree_node *>(tree->nodes.data());
      desc.references = const_cast<uint32_t *>(tree->references.data());
      GPURT_EXPECT_OK(gpurt_scene_import_tree(scene, &desc));
    }
    gpurt_build_desc desc = GPURT_BUILD_DESC_INIT;
    desc.accel = accel;
    desc.triangle_test = test;
    if (GetParam().is_fast) desc.quality = GPURT_BUILD_QUALITY_FAST;
    GPURT_EXPECT_OK(gpurt_scene_commit(scene, &desc));
    return scene;
  }

  // Rays of all kinds at this mesh and tree, and what exact geometry says of them.
  void make_rays(const std::vector<SplitPlane> &planes, const TestPrecision &precision, size_t count,
                 uint64_t seed)
  {
    RaySource source(named_.mesh, planes, seed);
    rays_.clear();
    truths_.clear();
    kinds_.clear();
    for (size_t i = 0; i < count; ++i) {
      const RayKind kind = RayKind(i % size_t(RayKind::Count));
      gpurt_ray ray = source(kind);
      // Some end near where something is met: at an edge point or vertex t is about 1.
      if (i % 16 == 1) ray.tmax = float(uniform(source.rng(), 0.5, 1.5));
      if (i % 32 == 3) ray.tmax = 1;
      if (i % 32 == 2) ray.tmin = 1;
      // The all-hits query below looks along whole lines too.
      rays_.push_back(ray);
      kinds_.push_back(kind);
      truths_.push_back((*oracle_)(ray, precision));
    }
  }

  void check_closest(gpurt_scene scene, const std::string &title)
  {
    const std::vector<gpurt_hit> hits = trace_closest(scene, rays_);
    Tally tally(title + ", closest");
    for (size_t i = 0; i < rays_.size(); ++i) {
      tally.add(judge_closest(truths_[i], rays_[i], hits[i]), rays_[i], ray_kind_names[int(kinds_[i])],
                hits[i].primitive, hits[i].t, truths_[i]);
    }
    tally.print();
    EXPECT_EQ(tally.failures(), 0u) << title;
    EXPECT_GT(tally[Outcome::ExactHit], rays_.size() / 20) << title << ": the rays hardly test anything";

    const std::vector<uint8_t> occluded = trace_any(scene, rays_);
    size_t num_different = 0;
    for (size_t i = 0; i < rays_.size(); ++i)
      num_different += occluded[i] != (hits[i].primitive != GPURT_INVALID_ID);
    EXPECT_EQ(num_different, 0u) << title << ": any hit and closest hit disagree";
    if (GetParam().is_cuda && !is_short_form()) check_large_batches(scene, title, hits, occluded);
  }

  // By warps that refill, which large batches alone take by themselves.
  void check_refilling_warps(gpurt_scene scene, const std::string &title)
  {
    const std::vector<gpurt_hit> expected = trace_closest(scene, rays_);
    std::vector<gpurt_hit> hits(rays_.size());
    std::vector<uint8_t> occluded(rays_.size(), 2);
    gpurt_trace_desc desc = by_refilling_warps(rays_);
    desc.hits = hits.data();
    GPURT_EXPECT_OK(gpurt_scene_trace(scene, &desc));
    desc.query = GPURT_QUERY_ANY;
    desc.hits = nullptr;
    desc.occluded = occluded.data();
    GPURT_EXPECT_OK(gpurt_scene_trace(scene, &desc));
    size_t num_different = 0;
    for (size_t i = 0; i < rays_.size(); ++i) {
      num_different += std::memcmp(&hits[i], &expected[i], sizeof(gpurt_hit)) != 0 ||
                       occluded[i] != (expected[i].primitive != GPURT_INVALID_ID);
    }
    EXPECT_EQ(num_different, 0u) << title << ": warps that refill";
  }

  // The same rays again and again, as many as it takes for kernels of large batches: what they say does not depend on that.
  void check_large_batches(gpurt_scene scene, const std::string &title, const std::vector<gpurt_hit> &hits,
                           const std::vector<uint8_t> &occluded)
  {
    std::vector<gpurt_ray> rays(large_batch);
    for (size_t i = 0; i < rays.size(); ++i) rays[i] = rays_[i % rays_.size()];
    for (const gpurt_coherence coherence : {GPURT_COHERENCE_COHERENT, GPURT_COHERENCE_INCOHERENT}) {
      const std::vector<gpurt_hit> large_hits = trace_closest(scene, rays, coherence);
      const std::vector<uint8_t> large_occluded = trace_any(scene, rays, coherence);
      size_t num_different = 0;
      for (size_t i = 0; i < rays.size(); ++i) {
        const size_t k = i % rays_.size();
        num_different +=
            std::memcmp(&large_hits[i], &hits[k], sizeof(gpurt_hit)) != 0 || large_occluded[i] != occluded[k];
      }
      EXPECT_EQ(num_different, 0u) << title << ": " << rays.size() << " rays at once, coherence "
                                   << coherence;
    }
  }

  // Along [tmin, tmax], and along the whole lines: a closed surface is crossed an even number of times.
  void check_all(gpurt_scene scene, const std::string &title)
  {
    for (const bool whole_line : {false, true}) {
      std::vector<gpurt_ray> rays = rays_;
      if (whole_line) {
        for (gpurt_ray &r : rays) r.tmin = std::numeric_limits<float>::lowest(), r.tmax = infinite;
      }
      std::vector<uint64_t> offsets;
      const std::vector<gpurt_hit> hits = trace_all(scene, rays, offsets);
      ASSERT_EQ(hits.size(), offsets.back());
      Tally tally(title + (whole_line ? ", all along lines" : ", all"));
      uint64_t num_odd = 0;
      for (size_t i = 0; i < rays.size(); ++i) {
        const gpurt_hit *first = hits.data() + offsets[i], *last = hits.data() + offsets[i + 1];
        tally.add(judge_all(truths_[i], rays[i], first, last), rays[i], ray_kind_names[int(kinds_[i])],
                  first == last ? GPURT_INVALID_ID : first->primitive, first == last ? 0 : first->t,
                  truths_[i]);
        num_odd += (last - first) & 1;
      }
      tally.print();
      EXPECT_EQ(tally.failures(), 0u) << title;
      if (whole_line && named_.is_closed) {
        EXPECT_EQ(num_odd, 0u) << title << ": odd crossings of a closed surface";
      }
    }
  }

  void agree_with_exact_geometry()
  {
    const std::string kind = GetParam().kind;
    const auto is_degenerate = [&](uint32_t i) { return oracle_->is_degenerate(i); };
    const Bounds bounds = bounds_of(named_.mesh);
    std::printf(
        "%s: %zu triangles; an edge is cleared beyond %.9g x 2^-24 x M, about %.3g of the mesh's extent\n",
        kind.c_str(), named_.mesh.triangles.size(), float_precision.edge_bound,
        float_precision.edge_bound * float_precision.unit_roundoff *
            std::max({std::abs(bounds.lo[0]), std::abs(bounds.hi[0]), bounds.extent()}) / bounds.extent());
    const ExchangeTree median =
        build_cgal_tree(named_.mesh, TreePoints::Vertices, TreeCut::Median, 6, is_degenerate);
    const ExchangeTree sliding =
        build_cgal_tree(named_.mesh, TreePoints::Centroids, TreeCut::SlidingMidpoint, 10, is_degenerate);

    // The same rays for all trees: half of those with origins in split planes use CGAL's planes, half the library's.
    const Scene own = make_scene(GPURT_TRIANGLE_WATERTIGHT);
    if (GetParam().is_fast) {
      // Of small meshes the host is quicker.
      EXPECT_EQ(facts_of(own).build_peak_bytes != 0, named_.mesh.triangles.size() > 2048) << kind;
    }
    const Scene kd_tree = make_scene(GPURT_ACCEL_KDTREE, GPURT_TRIANGLE_WATERTIGHT);
    std::vector<SplitPlane> planes = split_planes(exported_nodes(kd_tree));
    EXPECT_FALSE(planes.empty());
    const std::vector<SplitPlane> cgal_planes = split_planes(median.nodes);
    while (planes.size() < cgal_planes.size()) planes.insert(planes.end(), planes.begin(), planes.end());
    planes.resize(cgal_planes.size());
    planes.insert(planes.end(), cgal_planes.begin(), cgal_planes.end());

    make_rays(planes, float_precision, num_rays, 5);
    check_closest(own, kind + ", own tree");
    if (GetParam().is_cuda && is_short_form()) check_refilling_warps(own, kind + ", own tree");
    check_all(own, kind + ", own tree");
    if (is_kdtree() && !GetParam().is_fast) {
      const Scene imported = make_scene(GPURT_TRIANGLE_WATERTIGHT, &median);
      check_closest(imported, kind + ", CGAL median tree");
      check_all(imported, kind + ", CGAL median tree");
      const Scene slid = make_scene(GPURT_TRIANGLE_WATERTIGHT, &sliding);
      check_closest(slid, kind + ", CGAL sliding midpoint tree");
    }

    make_rays(planes, double_precision, num_rays / 5, 6);
    const Scene doubled = make_scene(GPURT_TRIANGLE_DOUBLE);
    check_closest(doubled, kind + ", own tree, double");
    std::printf("%s: %.3g decisions, %.4f%% by rational arithmetic\n", kind.c_str(),
                double(oracle_->num_decisions),
                100.0 * double(oracle_->num_exact_decisions) / double(oracle_->num_decisions));
  }

  Device device_;
  NamedMesh named_;
  std::optional<ExactOracle> oracle_;
  std::vector<gpurt_ray> rays_;
  std::vector<RayKind> kinds_;
  std::vector<RayTruth> truths_;
};

TEST_P(Hits, AgreeWithExactGeometry) { agree_with_exact_geometry(); }

// Trees that the device builds.
class FastHits : public Hits {};

TEST_P(FastHits, AgreeWithExactGeometry) { agree_with_exact_geometry(); }

TEST_P(Hits, ImportedTreesComeBackAsTheyWere)
{
  if (!is_kdtree()) {
    gpurt_kdtree none = GPURT_KDTREE_INIT;
    EXPECT_EQ(gpurt_scene_export_tree(make_scene(GPURT_TRIANGLE_WATERTIGHT), &none),
              GPURT_ERROR_INVALID_ARGUMENT);
    EXPECT_NE(std::string(gpurt_last_error()).find("bvh"), std::string::npos) << gpurt_last_error();
    return;
  }
  const ExchangeTree tree = build_cgal_tree(named_.mesh, TreePoints::Vertices, TreeCut::Median, 8);
  const Scene scene = make_scene(GPURT_TRIANGLE_WATERTIGHT, &tree);
  gpurt_kdtree out = GPURT_KDTREE_INIT;
  GPURT_ASSERT_OK(gpurt_scene_export_tree(scene, &out));
  ASSERT_EQ(out.num_nodes, tree.nodes.size());
  ASSERT_EQ(out.num_references, tree.references.size());
  EXPECT_EQ(out.num_triangles, named_.mesh.triangles.size());
  std::vector<gpurt_kdtree_node> nodes(out.num_nodes);
  std::vector<uint32_t> references(out.num_references);
  out.nodes = nodes.data();
  out.references = references.data();
  GPURT_ASSERT_OK(gpurt_scene_export_tree(scene, &out));
  // The library may lay nodes out anew; what it gives out is then laid out for good.
  ExchangeTree given_out = tree;
  given_out.nodes = nodes;
  given_out.references = references;
  const Scene again = make_scene(GPURT_TRIANGLE_WATERTIGHT, &given_out);
  std::vector<gpurt_kdtree_node> nodes_again(out.num_nodes);
  std::vector<uint32_t> references_again(out.num_references);
  gpurt_kdtree twice = out;
  twice.nodes = nodes_again.data();
  twice.references = references_again.data();
  GPURT_ASSERT_OK(gpurt_scene_export_tree(again, &twice));
  EXPECT_EQ(std::memcmp(nodes.data(), nodes_again.data(), nodes.size() * sizeof nodes[0]), 0);
  EXPECT_EQ(references, references_again);
  gpurt_scene_facts facts = GPURT_SCENE_FACTS_INIT;
  GPURT_ASSERT_OK(gpurt_scene_get_facts(scene, &facts));
  EXPECT_EQ(facts.tree_depth, tree.depth);
  EXPECT_EQ(facts.tree_from_cache, 1u);
}

std::string name_of(const ::testing::TestParamInfo<Params> &info)
{
  return std::string(info.param.is_cuda ? "cuda_" : "") +
         (info.param.accel == GPURT_ACCEL_BVH ? "bvh_" : "") + info.param.kind;
}
INSTANTIATE_TEST_SUITE_P(Meshes, Hits, ::testing::ValuesIn(all_params(false)), name_of);
INSTANTIATE_TEST_SUITE_P(Meshes, FastHits, ::testing::ValuesIn(all_params(true)), name_of);

}  // namespace
