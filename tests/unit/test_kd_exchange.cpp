// Trees from outside: import, export, cache files, and what is refused.
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>

#include "accel/kd_cache.h"
#include "accel/kd_check.h"
#include "accel_test.h"

namespace gpurt {
namespace {

using namespace test;
namespace fs = std::filesystem;

KdNode inner(int axis, float plane, uint32_t child)
{
  return {float_bits(plane), child << 2 | uint32_t(axis)};
}
KdNode leaf(uint32_t first, uint32_t count) { return {first, count << 2 | 3u}; }

// Two triangles, one on either side of x = 0.
Mesh two_triangles()
{
  Mesh m;
  m.add({-2, 0, 0}, {-1, 0, 0}, {-2, 1, 0});
  m.add({1, 0, 0}, {2, 0, 0}, {1, 1, 0});
  return m;
}

HostKdTree small_tree()
{
  HostKdTree t;
  t.bounds = {{-2, 0, 0}, {2, 1, 0}};
  t.num_triangles = 2;
  t.nodes = {inner(0, 0, 1), leaf(0, 1), leaf(1, 1)};
  t.references = {0, 1};
  return t;
}

BuildOptions importing(const HostKdTree &tree, uint32_t id = 0)
{
  BuildOptions options = kd_options();
  options.imported.emplace_back(id, std::make_shared<HostKdTree>(tree));
  return options;
}

std::string refusal(const HostKdTree &tree)
{
  try {
    commit(scene_of(two_triangles()), importing(tree));
  } catch (const Error &error) {
    EXPECT_EQ(error.result(), GPURT_ERROR_INVALID_ARGUMENT);
    return error.what();
  }
  return "";
}

TEST(KdImport, ATreeMadeByHandDrivesTheTraversal)
{
  const auto committed = commit(scene_of(two_triangles()), importing(small_tree()));
  const std::vector<Hit> hits = trace(*committed, {{{-1.75f, 0.25f, 1}, 0, {0, 0, -1}, infinity},
                                                   {{1.25f, 0.25f, 1}, 0, {0, 0, -1}, infinity},
                                                   {{0, 0.25f, 1}, 0, {0, 0, -1}, infinity}});
  EXPECT_EQ(hits[0].triangle, 0u);
  EXPECT_EQ(hits[1].triangle, 1u);
  EXPECT_EQ(hits[2].triangle, invalid_id);
  EXPECT_TRUE(committed->accel_facts().from_cache);
  EXPECT_EQ(committed->accel_facts().tree_depth, 1u);

  // Leaves decide: with the references swapped, nothing is found.
  HostKdTree swapped = small_tree();
  std::swap(swapped.references[0], swapped.references[1]);
  for (const Hit &h : trace(*commit(scene_of(two_triangles()), importing(swapped)),
                            {{{-1.75f, 0.25f, 1}, 0, {0, 0, -1}, infinity}})) {
    EXPECT_EQ(h.triangle, invalid_id);
  }
}

TEST(KdImport, BrokenTreesAreRefusedByName)
{
  HostKdTree t = small_tree();
  t.references[1] = 2;
  EXPECT_NE(refusal(t).find("reference 1"), std::string::npos);

  t = small_tree();
  t.nodes[0] = inner(0, 0, 2);  // the second child lies outside
  EXPECT_NE(refusal(t).find("node 0"), std::string::npos);

  t = small_tree();
  t.nodes[0] = inner(0, 0, 0);  // its own child
  EXPECT_NE(refusal(t).find("node 0"), std::string::npos);

  t = small_tree();
  t.nodes[0] = inner(0, 3, 1);
  EXPECT_NE(refusal(t).find("outside of its cell"), std::string::npos);

  t = small_tree();
  t.nodes[0] = inner(0, std::nanf(""), 1);
  EXPECT_NE(refusal(t).find("node 0"), std::string::npos);

  t = small_tree();
  t.nodes[2] = leaf(1, 2);
  EXPECT_NE(refusal(t).find("leaf 2"), std::string::npos);

  t = small_tree();
  t.nodes[2] = leaf(0xffffffffu, 0x3fffffffu);
  EXPECT_NE(refusal(t).find("leaf 2"), std::string::npos);

  t = small_tree();
  t.nodes = {inner(0, 0, 1), inner(0, -1, 3), inner(0, 1, 3), leaf(0, 1), leaf(1, 1)};
  EXPECT_NE(refusal(t).find("reached twice"), std::string::npos);

  t = small_tree();
  t.nodes.push_back(leaf(0, 0));
  EXPECT_NE(refusal(t).find("node 3"), std::string::npos);

  t = small_tree();
  t.bounds.hi.x = 1.5f;
  EXPECT_NE(refusal(t).find("bounds"), std::string::npos);

  t = small_tree();
  t.num_triangles = 3;
  EXPECT_NE(refusal(t).find("3 triangles"), std::string::npos);

  EXPECT_THROW(commit(scene_of(two_triangles()), importing(small_tree(), 7)), Error);
}

// Catalogue row 18.
TEST(KdImport, TheDepthLimitIsExact)
{
  // Above the plane the chain goes on, so that planes must rise.
  const auto rising = [](uint32_t depth) {
    HostKdTree t = small_tree();
    t.nodes.assign(1, {});
    for (uint32_t d = 0; d < depth; ++d) {
      const uint32_t parent = uint32_t(t.nodes.size()) - 1;
      t.nodes[parent] = inner(0, -1.5f + 3.0f * float(d) / 64.0f, parent + 1);
      t.nodes.push_back(leaf(0, 2));
      t.nodes.push_back(leaf(0, 2));
    }
    return t;
  };
  EXPECT_EQ(refusal(rising(48)), "");
  EXPECT_NE(refusal(rising(49)).find("48"), std::string::npos);
  const auto committed = commit(scene_of(two_triangles()), importing(rising(48)));
  const auto plain = commit(scene_of(two_triangles()));
  Random rng(31);
  const std::vector<Ray> rays = mixed_rays(rng, 20000, 2);
  const std::vector<Hit> hits = trace(*committed, rays), expected = trace(*plain, rays);
  for (size_t i = 0; i < rays.size(); ++i) ASSERT_TRUE(same_bits(hits[i], expected[i]));
}

TEST(KdImport, ExportedTreesComeBackUnchanged)
{
  Random rng(32);
  SceneMaker maker;
  Mesh mesh = soup(rng, 2000, 0.2f, 1);
  for (int i = 0; i < 20; ++i) mesh.add({9, 9, 9}, {9, 9, 9}, {9, 9, 8});  // degenerate, outside of the rest
  maker.add_world(mesh);
  const Transform one = {{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
  maker.add_shared(icosphere(2, 0.5f), {one, one}, {one, one});
  const auto scene = maker.scene();
  const auto built = commit(scene);
  BuildOptions options = importing(built->export_tree(0));
  options.imported.emplace_back(2, std::make_shared<HostKdTree>(built->export_tree(2)));
  const auto imported = commit(scene, options);
  for (uint32_t id : {0u, 2u}) {
    const HostKdTree a = built->export_tree(id), b = imported->export_tree(id);
    EXPECT_EQ(a.references, b.references);
    ASSERT_EQ(a.nodes.size(), b.nodes.size());
    EXPECT_EQ(std::memcmp(a.nodes.data(), b.nodes.data(), a.nodes.size() * sizeof(KdNode)), 0);
  }
  EXPECT_THROW(built->export_tree(1), Error);  // geometry 0 is placed once
  BuildOptions embree = kd_options();
  embree.accel = Accel::Embree;
  EXPECT_THROW(commit(scene, embree)->export_tree(0), Error);
}

class KdCache : public testing::Test {
 protected:
  void SetUp() override
  {
    folder_ = fs::temp_directory_path() / fmt::format("gpurt_kd_cache_{}", ::getpid());
    fs::create_directories(folder_);
    options_ = kd_options();
    options_.cache_path = (folder_ / "tree").string();
    Random rng(33);
    SceneMaker maker;
    maker.add_world(soup(rng, 1000, 0.2f, 1));
    const Transform one = {{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
    maker.add_shared(icosphere(1, 0.5f), {one, one}, {one, one});
    scene_ = maker.scene();
    rays_ = mixed_rays(rng, 2000, 1);
  }
  void TearDown() override { fs::remove_all(folder_); }

  // Commits, and tells whether the file was used; hits are always those of a fresh build.
  bool uses_cache()
  {
    const auto committed = commit(scene_, options_);
    const std::vector<Hit> hits = trace(*committed, rays_), expected = trace(*commit(scene_), rays_);
    for (size_t i = 0; i < rays_.size(); ++i) EXPECT_TRUE(same_bits(hits[i], expected[i]));
    EXPECT_GT(committed->accel_facts().sah_cost, 0);
    BuildOptions fresh = options_;
    fresh.cache_path.clear();
    EXPECT_EQ(committed->accel_facts().tree_depth, commit(scene_, fresh)->accel_facts().tree_depth);
    return committed->accel_facts().from_cache;
  }
  std::string read() const
  {
    std::ifstream f(options_.cache_path, std::ios::binary);
    return {std::istreambuf_iterator<char>(f), {}};
  }
  void write(const std::string &bytes) const
  {
    std::ofstream(options_.cache_path, std::ios::binary) << bytes;
  }

  fs::path folder_;
  BuildOptions options_;
  std::shared_ptr<CompiledScene> scene_;
  std::vector<Ray> rays_;
};

TEST_F(KdCache, IsWrittenOnceAndUsed)
{
  EXPECT_FALSE(uses_cache());
  EXPECT_TRUE(uses_cache());
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), {}), 1);  // no temporary is left
  options_.traversal_cost = 3;
  EXPECT_FALSE(uses_cache());  // other options, another tree
  EXPECT_TRUE(uses_cache());
  scene_->hash += 1;
  EXPECT_FALSE(uses_cache());
}

TEST_F(KdCache, DamageIsNoticed)
{
  EXPECT_FALSE(uses_cache());
  const std::string whole = read();
  for (size_t length : {size_t(0), size_t(5), size_t(30), whole.size() / 2, whole.size() - 1}) {
    write(whole.substr(0, length));
    EXPECT_FALSE(uses_cache()) << length;
  }
  write(whole + "x");
  EXPECT_FALSE(uses_cache());
  for (size_t i = 0; i < whole.size(); i += 1 + whole.size() / 61) {
    std::string bent = whole;
    bent[i] = char(bent[i] ^ 0x10);
    write(bent);
    EXPECT_FALSE(uses_cache()) << i;
  }
  write(whole);
  EXPECT_TRUE(uses_cache());
}

TEST_F(KdCache, AFolderThatCannotBeWrittenIsAnError)
{
  options_.cache_path = (folder_ / "no" / "such" / "folder").string();
  try {
    commit(scene_, options_);
    FAIL();
  } catch (const Error &error) {
    EXPECT_EQ(error.result(), GPURT_ERROR_IO);
    EXPECT_NE(std::string(error.what()).find(options_.cache_path), std::string::npos);
  }
}

}  // namespace
}  // namespace gpurt
