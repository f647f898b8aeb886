#include "texture.h"

#include <png.h>

#include <algorithm>
#include <stdexcept>
#include <string>

namespace cli::scenes {

namespace {

uint8_t to_srgb8(double x)
{
  x = std::clamp(x, 0.0, 1.0);
  return uint8_t(std::lround(255 * (x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(x, 1 / 2.4) - 0.055)));
}

// Where a point lies along a segment: distance from it, and the share of its length.
struct Along {
  double distance, t;
};
Along along_segment(double x, double y, double x0, double y0, double x1, double y1)
{
  const double dx = x1 - x0, dy = y1 - y0;
  const double t = std::clamp(((x - x0) * dx + (y - y0) * dy) / (dx * dx + dy * dy), 0.0, 1.0);
  return {std::hypot(x - x0 - t * dx, y - y0 - t * dy), t};
}

}  // namespace

std::vector<uint8_t> make_png(int width, int height, bool has_alpha,
                              const std::function<Texel(double u, double v)> &texel)
{
  const int channels = has_alpha ? 4 : 3;
  std::vector<uint8_t> pixels;
  pixels.reserve(size_t(width) * size_t(height) * size_t(channels));
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const Texel t = texel((x + 0.5) / width, (y + 0.5) / height);
      for (double c : {t.color.x, t.color.y, t.color.z}) pixels.push_back(to_srgb8(c));
      if (has_alpha) pixels.push_back(uint8_t(std::lround(255 * std::clamp(t.alpha, 0.0, 1.0))));
    }
  }
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = uint32_t(width);
  image.height = uint32_t(height);
  image.format = has_alpha ? PNG_FORMAT_RGBA : PNG_FORMAT_RGB;
  png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(image);
  std::vector<uint8_t> png(size);
  if (!png_image_write_to_memory(&image, png.data(), &size, 0, pixels.data(), 0, nullptr)) {
    throw std::runtime_error(std::string("a texture cannot be encoded: ") + image.message);
  }
  png.resize(size);
  return png;
}

std::vector<uint8_t> wood_planks(int size)
{
  constexpr int num_planks = 12;
  return make_png(size, size, false, [&](double u, double v) {
    const int plank = int(u * num_planks);
    const double across = u * num_planks - plank;
    // Planks are a metre long, and their ends are staggered.
    const double shifted = v * 2 + 0.37 * plank;
    const int piece = int(std::floor(shifted)) % 2;
    const double along = shifted - std::floor(shifted);
    const auto id = uint32_t(plank * 2 + piece);
    // Grain: rings of a trunk cut lengthwise, bent by noise.
    const double bend = fractal_noise({across * 1.5, along * 2.5, id * 7.3}, 3, id);
    const double rings = std::sin((across * 5 + bend * 2.2 + id) * 6);
    const double fibre = noise({across * 90, along * 6, id * 3.1}, 5);
    const double tone = 0.85 + 0.3 * noise({id * 1.7, 0.5, 0.5}, 9);
    const double grain = 0.84 + 0.10 * rings + 0.07 * fibre;
    const double gap = std::min({across, 1 - across, along * 6, (1 - along) * 6});
    const double seam = 0.25 + 0.75 * smooth_step(0.0, 0.03, gap);
    return Texel{Vec3{0.58, 0.36, 0.19} * (grain * tone * seam)};
  });
}

std::vector<uint8_t> bark(int size)
{
  return make_png(size, size, false, [](double u, double v) {
    // On a cylinder, so that left and right fit.
    const Vec3 p{std::cos(2 * pi * u) * 1.2, v * 3, std::sin(2 * pi * u) * 1.2};
    const double ridges = std::abs(fractal_noise({p.x * 3, p.y * 0.9, p.z * 3}, 4, 3));
    const double fine = fractal_noise(p * 9, 2, 8);
    return Texel{Vec3{0.16, 0.115, 0.08} * (0.45 + 1.3 * ridges + 0.2 * fine)};
  });
}

std::vector<uint8_t> leaf_twig(int size)
{
  struct Leaf {
    double x, y, angle, length, tone;
  };
  std::vector<Leaf> leaves;
  Sequence random(5);
  for (int i = 0; i < 18; ++i) {
    const double t = (i + 0.5) / 18;
    const double side = i % 2 ? 1 : -1;
    leaves.push_back({0.5 + 0.06 * std::sin(t * 6), 0.96 - 0.75 * t,
                      side * random.range(0.5, 1.25) + (i == 17 ? -side : 0) * 0.6,
                      random.range(0.20, 0.30) * (1 - 0.35 * t), random.range(0.75, 1.25)});
  }
  return make_png(size, size, true, [leaves](double u, double v) {
    const double stem_x = 0.5 + 0.06 * std::sin((0.96 - v) / 0.75 * 6);
    Texel texel{{0.05, 0.12, 0.02}, 0};
    if (v > 0.2 && std::abs(u - stem_x) < 0.009) texel = {{0.13, 0.10, 0.05}, 1};
    for (const Leaf &leaf : leaves) {
      // Along the leaf from its foot (0) to its tip (1), and across it.
      const double dx = u - leaf.x, dy = leaf.y - v, s = std::sin(leaf.angle), c = std::cos(leaf.angle);
      const double a = (dx * s + dy * c) / leaf.length, b = (dx * c - dy * s) / leaf.length;
      if (a <= 0.02 || a >= 1) continue;
      const double half = 0.30 * std::pow(std::sin(pi * std::pow(a, 0.8)), 0.9);
      if (std::abs(b) > half) continue;
      const double rib = 1 - 0.35 * std::exp(-std::abs(b) * 60),
                   veins = 1 + 0.10 * std::sin(a * 45 - std::abs(b) * 40);
      texel = {Vec3{0.12, 0.25, 0.038} * (leaf.tone * veins / rib * (0.8 + 0.4 * a)), 1};
    }
    return texel;
  });
}

std::vector<uint8_t> needle_twig(int size)
{
  return make_png(size, size, true, [](double u, double v) {
    Texel texel{{0.03, 0.08, 0.025}, 0};
    // Side twigs leave the middle in pairs and get shorter towards the tip; each carries needles on both sides.
    const auto add_twig = [&](double x0, double y0, double x1, double y1, double width, double tone) {
      const Along a = along_segment(u, v, x0, y0, x1, y1);
      const double needles =
          0.55 + 0.45 * std::sin((u * (x1 - x0) + v * (y1 - y0)) / std::hypot(x1 - x0, y1 - y0) * 260 +
                                 a.distance * 90);
      const double reach = width * (1 - 0.55 * a.t) * (0.45 + 0.55 * needles);
      if (a.distance < reach) texel = {Vec3{0.065, 0.155, 0.05} * tone * (0.7 + 0.6 * a.distance / width), 1};
      if (a.distance < 0.004) texel = {{0.09, 0.06, 0.035}, 1};
    };
    Sequence random(11);
    add_twig(0, 0.5, 0.99, 0.5, 0.055, 1);
    for (int i = 0; i < 11; ++i) {
      const double x = 0.03 + 0.082 * i, reach = 0.42 * (1 - x * 0.85);
      for (double side : {-1.0, 1.0}) {
        const double lean = random.range(0.5, 0.75), tone = random.range(0.8, 1.25);
        add_twig(x, 0.5, x + reach * lean, 0.5 + side * reach, 0.042, tone);
      }
    }
    return texel;
  });
}

std::vector<uint8_t> grass_blades(int size)
{
  struct Blade {
    double x, height, lean, width, tone;
  };
  std::vector<Blade> blades;
  Sequence random(3);
  for (int i = 0; i < 34; ++i) {
    blades.push_back({random.range(0.12, 0.88), random.range(0.45, 0.97), random.range(-0.25, 0.25),
                      random.range(0.010, 0.020), random.range(0.7, 1.3)});
  }
  return make_png(size, size, true, [blades](double u, double v) {
    Texel texel{{0.10, 0.17, 0.035}, 0};
    for (const Blade &blade : blades) {
      const double t = (1 - v) / blade.height;
      if (t >= 1) continue;
      const double x = blade.x + blade.lean * t * t;
      if (std::abs(u - x) < blade.width * (1 - t * t))
        texel = {Vec3{0.20, 0.29, 0.065} * (blade.tone * (0.6 + 0.5 * t)) + Vec3{0.05, 0.03, 0} * (t * t), 1};
    }
    return texel;
  });
}

std::vector<uint8_t> flowers(int size)
{
  struct Flower {
    double x, height, lean, radius;
    Vec3 petals;
  };
  std::vector<Flower> all;
  Sequence random(29);
  const Vec3 colors[] = {{0.86, 0.84, 0.80}, {0.85, 0.60, 0.06}, {0.42, 0.20, 0.62}};
  for (int i = 0; i < 9; ++i) {
    all.push_back({random.range(0.2, 0.8), random.range(0.5, 0.88), random.range(-0.12, 0.12),
                   random.range(0.045, 0.075), colors[i % 3]});
  }
  return make_png(size, size, true, [all](double u, double v) {
    Texel texel{{0.10, 0.17, 0.035}, 0};
    for (const Flower &flower : all) {
      const double t = (1 - v) / flower.height;
      if (t < 1 && std::abs(u - flower.x - flower.lean * t * t) < 0.009) texel = {{0.10, 0.19, 0.045}, 1};
      const double dx = u - flower.x - flower.lean, dy = v - 1 + flower.height, r = std::hypot(dx, dy);
      const double petal = flower.radius * (0.78 + 0.22 * std::cos(7 * std::atan2(dy, dx)));
      if (r < petal) texel = {flower.petals * (0.7 + 0.3 * r / petal), 1};
      if (r < 0.32 * flower.radius) texel = {{0.75, 0.45, 0.04}, 1};
    }
    return texel;
  });
}

}  // namespace cli::scenes
