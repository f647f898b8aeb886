// How often lamps with textures are drawn: means over triangles that are 0 only where nothing shines.
#include "scene/lamp_texture.h"

#include <cmath>
#include <random>

#include "core/path/lights.h"
#include "core/path/warp.h"
#include "scene_builders.h"

namespace gpurt {
namespace {

struct Image {
  std::vector<float> texels;
  Texture texture;

  Image(uint32_t width, uint32_t height, Wrap wrap, bool nearest) : texels(size_t(width) * height * 4)
  {
    texture = {texels.data(), width, height, TexelFormat::Rgba32f, wrap, wrap, nearest ? 1u : 0u};
  }
  void set(uint32_t x, uint32_t y, float value)
  {
    for (uint32_t c = 0; c < 3; ++c) texels[(size_t(y) * texture.width + x) * 4 + c] = value;
  }
};

using Triangle = Vec2f[3];

// The brightest and the mean of lookups all over the triangle.
void look(const Texture &texture, const Triangle &uv, std::mt19937 &random, int count, float &brightest,
          double &mean)
{
  std::uniform_real_distribution<float> unit(0, 1);
  double sum = 0;
  brightest = 0;
  for (int i = 0; i < count; ++i) {
    const Vec2f b = sample_triangle({unit(random), unit(random)});
    const float w = 1 - b.x - b.y;
    const float x = sample_texture(texture, {fma(w, uv[0].x, fma(b.x, uv[1].x, b.y * uv[2].x)),
                                             fma(w, uv[0].y, fma(b.x, uv[1].y, b.y * uv[2].y))})
                        .r;
    brightest = std::max(brightest, x);
    sum += double(x);
  }
  mean = sum / count;
}

// One bright texel, in triangles of any size and place: where a lookup finds it, the mean knows of it.
TEST(LampTexture, ATriangleThatShinesAnywhereHasAMean)
{
  std::mt19937 random(3);
  std::uniform_real_distribution<float> unit(-1, 1);
  int num_bright = 0, num_dark = 0;
  for (const Wrap wrap : {Wrap::Repeat, Wrap::Clamp, Wrap::Mirror}) {
    for (const bool nearest : {false, true}) {
      for (const uint32_t width : {1u, 7u, 64u}) {
        Image image(width, 37, wrap, nearest);
        image.set(width / 3, 36, 5);
        const LampTexture lamp(image.texture);
        for (int i = 0; i < 300; ++i) {
          const float size = std::pow(10.0f, 3 * unit(random) - 1.5f);
          const Vec2f at{2 * unit(random), 2 * unit(random)};
          Triangle uv;
          for (Vec2f &p : uv) p = {at.x + size * unit(random), at.y + size * unit(random)};
          if (i % 10 == 0) uv[2] = uv[1];
          float brightest;
          double mean;
          look(image.texture, uv, random, 300, brightest, mean);
          const float known = lamp.mean(uv).x;
          ASSERT_TRUE(std::isfinite(known));
          ASSERT_LE(known, 5);
          if (brightest > 0) {
            ++num_bright;
            ASSERT_GT(known, 0) << width << " " << i;
          }
          if (known == 0) ++num_dark;
        }
      }
    }
  }
  EXPECT_GT(num_bright, 500);
  EXPECT_GT(num_dark, 500);
}

TEST(LampTexture, MeansAreNearThoseOfLookups)
{
  std::mt19937 random(5);
  std::uniform_real_distribution<float> unit(0, 1);
  for (const Wrap wrap : {Wrap::Repeat, Wrap::Clamp, Wrap::Mirror}) {
    Image image(300, 200, wrap, false);
    for (uint32_t y = 0; y < 200; ++y) {
      for (uint32_t x = 0; x < 300; ++x) image.set(x, y, x < 150 ? 0.0f : 1.0f + float(y) / 100);
    }
    const LampTexture lamp(image.texture);
    const Triangle triangles[] = {{{0, 0}, {1, 0}, {1, 1}},
                                  {{0, 0}, {1, 1}, {0, 1}},
                                  {{0.4f, 0.1f}, {0.6f, 0.1f}, {0.5f, 0.3f}},
                                  {{-0.7f, 0.2f}, {1.9f, 0.4f}, {0.3f, 2.2f}},
                                  {{0.7f, 0.2f}, {0.72f, 0.2f}, {0.71f, 0.9f}}};
    for (const Triangle &uv : triangles) {
      float brightest;
      double mean;
      look(image.texture, uv, random, 200000, brightest, mean);
      // Cells at the rim: up to one in 16 along a side. The lookups' own noise is 0.3 %.
      EXPECT_NEAR(lamp.mean(uv).x, mean, 0.06 * mean + 0.01);
    }
  }
}

TEST(LampTexture, FarAwayTheWholeImageCounts)
{
  Image image(4, 4, Wrap::Repeat, false);
  for (uint32_t x = 0; x < 4; ++x) image.set(x, 1, 8);
  const LampTexture lamp(image.texture);
  EXPECT_EQ(lamp.mean({{0, 0}, {1e9f, 0}, {0, 1e9f}}).x, 2);
  EXPECT_EQ(lamp.mean({{0, 0}, {1e38f, 0}, {0, -1e38f}}).x, 2);
  EXPECT_EQ(lamp.mean({{0.5f, 0.375f}, {0.5f, 0.375f}, {0.5f, 0.375f}}).x, 8.0f / 3) << "three rows are near";
}

// A lamp of four triangles, of which those that shine have a part in the light tree, in proportion to what they emit.
TEST(LampTexture, LampsAreDrawnByTheirMeans)
{
  SceneData d;
  std::vector<std::byte> texels(4 * 4);
  for (int i = 0; i < 16; ++i) texels[size_t(i)] = std::byte(i < 8 ? 255 : 0);
  TextureData t;
  t.width = 4;
  t.height = 1;
  t.nearest = true;
  t.format = TexelFormat::Rgba8Linear;
  t.texels = std::make_shared<const std::vector<std::byte>>(texels);
  MaterialSettings m;
  m.emission = {2, 3, 4};
  m.emission_texture = add_texture(d, t);
  MeshData mesh = make_mesh({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {2, 0, 0}, {2, 1, 0}},
                            {{0, 1, 2}, {0, 2, 3}, {1, 4, 5}, {1, 5, 2}});
  mesh.uvs = SharedArray<Vec2f>(std::vector<Vec2f>{
      {0.125f, 0.5f}, {0.375f, 0.5f}, {0.375f, 0.6f}, {0.125f, 0.6f}, {0.9f, 0.5f}, {0.9f, 0.6f}});
  const uint32_t lamp = add_mesh(d, mesh, add_material(d, m));
  add_instance(d, lamp, identity_affine);
  const CompiledScene s = compile_scene(d, 0);
  const SceneView view = s.view();
  EXPECT_EQ(view.has_emission_textures, 1u);
  ASSERT_EQ(s.lights.size(), 4u);
  for (int k = 0; k < 2; ++k) EXPECT_EQ(s.lights[size_t(k)].color.y, 3) << "white all over";
  // Up to u = 1/2 of 0.375 to 0.9: towards a tip, and from a side.
  const float tip = 0.125f / 0.525f, rest = 0.4f / 0.525f;
  EXPECT_NEAR(s.lights[2].color.y, 3 * tip * tip, 0.01);
  EXPECT_NEAR(s.lights[3].color.y, 3 * (1 - rest * rest), 0.01);
  // What is sent from a point is the texel, not the mean.
  EXPECT_EQ(lamp_radiance(view, s.lights[0], {0.25f, 0.25f}).y, 3);
  EXPECT_EQ(lamp_radiance(view, s.lights[2], {0.5f, 0.4f}).y, 0);
}

}  // namespace
}  // namespace gpurt
