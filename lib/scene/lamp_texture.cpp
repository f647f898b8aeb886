#include "scene/lamp_texture.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/scene/texture.h"
#include "scene/parallel.h"

namespace gpurt {
namespace {

// Cells of a level that a triangle is cut into, at most.
constexpr uint64_t max_cells = 1024;

// Beyond so many texels lookups read texel 0.
constexpr double max_coordinate = 0x1p31;

struct Point {
  double x, y;
};

// A convex polygon: a triangle that up to four lines have cut.
struct Polygon {
  Point corners[7];
  int size = 0;

  void add(Point p) { corners[size++] = p; }
};

// The part where sign * (coordinate - bound) >= 0.
template <double Point::*Axis>
Polygon cut(const Polygon &from, double bound, double sign)
{
  Polygon to;
  for (int i = 0; i < from.size; ++i) {
    const Point p = from.corners[i], q = from.corners[(i + 1) % from.size];
    const double a = sign * (p.*Axis - bound), b = sign * (q.*Axis - bound);
    if (a >= 0) to.add(p);
    if ((a < 0) != (b < 0)) {
      const double t = a / (a - b);
      to.add({p.x + (q.x - p.x) * t, p.y + (q.y - p.y) * t});
    }
  }
  return to;
}

double area(const Polygon &p)
{
  double sum = 0;
  for (int i = 1; i + 1 < p.size; ++i) {
    sum += (p.corners[i].x - p.corners[0].x) * (p.corners[i + 1].y - p.corners[0].y) -
           (p.corners[i].y - p.corners[0].y) * (p.corners[i + 1].x - p.corners[0].x);
  }
  return 0.5 * std::fabs(sum);
}

// Texels first to last along an axis, wrapped or not, of which lookups between two coordinates may read.
struct Reach {
  int64_t first, last;
  double margin;  // how far beyond its own bounds a texel is read

  Reach(double lo, double hi, bool nearest)
  {
    // More than the roundings of coordinates in lookups.
    margin = (nearest ? 0.0 : 0.5) + 0x1p-20 * std::max(std::fabs(lo), std::fabs(hi));
    first = int64_t(std::floor(lo - margin));
    last = int64_t(std::floor(hi + margin));
  }
  uint64_t num_texels() const { return uint64_t(last - first) + 1; }
};

// A run of texels that belong to one cell of a level, with the coordinates at which they are read.
struct Span {
  double lo, hi;
  uint32_t cell;
};

// The runs of a reach. More than max_cells of them are not told apart: false.
bool find_spans(const Reach &reach, uint32_t size, Wrap wrap, uint32_t level, std::vector<Span> &spans)
{
  spans.clear();
  for (int64_t i = reach.first; i <= reach.last;) {
    if (spans.size() == max_cells) return false;
    const uint32_t cell = wrap_texel(i, size, wrap) >> level;
    int64_t end = reach.last + 1;
    // Beyond a clamped image its edge goes on; elsewhere the next texel of another cell is near.
    if (wrap != Wrap::Clamp || (i >= 0 && i < int64_t(size))) {
      const int64_t m = wrap_texel(i, size, wrap);
      const bool descends = wrap == Wrap::Mirror && wrap_texel(i + 1, size, wrap) < m;
      const int64_t cell_end = std::min<int64_t>(int64_t(cell + 1) << level, size);
      end = std::min(end, i + (descends ? m - (int64_t(cell) << level) + 1 : cell_end - m));
    } else if (i < 0) {
      end = std::min<int64_t>(end, 0);
    }
    spans.push_back({double(i) - reach.margin, double(end) + reach.margin, cell});
    i = end;
  }
  return true;
}

// Means of what is more than 0 do not vanish.
float rounded(double x) { return x > 0 ? std::max(float(x), std::numeric_limits<float>::min()) : 0.0f; }

}  // namespace

LampTexture::LampTexture(const Texture &texture) : texture_(texture)
{
  for (uint32_t k = 0, width = texture.width, height = texture.height; width > 1 || height > 1; ++k) {
    const uint32_t below_width = width, below_height = height;
    width = (width + 1) / 2;
    height = (height + 1) / 2;
    Level level{width, height, std::vector<Vec3f>(size_t(width) * height)};
    // Cells at the right and lower edge may have fewer texels below them.
    parallel_for_each(level.texels.size(), [&](uint64_t i) {
      const uint32_t x = uint32_t(i % width), y = uint32_t(i / width);
      double sum[3] = {0, 0, 0};
      int count = 0;
      for (uint32_t v = 2 * y; v < std::min(2 * y + 2, below_height); ++v) {
        for (uint32_t u = 2 * x; u < std::min(2 * x + 2, below_width); ++u, ++count) {
          const Vec3f t = texel(k, u, v);
          sum[0] += t.x;
          sum[1] += t.y;
          sum[2] += t.z;
        }
      }
      level.texels[i] = {rounded(sum[0] / count), rounded(sum[1] / count), rounded(sum[2] / count)};
    });
    coarser_.push_back(std::move(level));
  }
}

Vec3f LampTexture::texel(uint32_t level, uint32_t x, uint32_t y) const
{
  if (level != 0) return coarser_[level - 1].texels[size_t(y) * coarser_[level - 1].width + x];
  const Texel t = fetch_texel(texture_, x, y);
  return {t.r, t.g, t.b};
}

Vec3f LampTexture::mean(const Vec2f (&uv)[3]) const
{
  Polygon triangle;
  for (const Vec2f &p : uv) triangle.add({double(p.x) * texture_.width, double(p.y) * texture_.height});
  double lo[2], hi[2];
  for (int axis = 0; axis < 2; ++axis) {
    const auto of = [&](int i) { return axis == 0 ? triangle.corners[i].x : triangle.corners[i].y; };
    lo[axis] = std::min({of(0), of(1), of(2)});
    hi[axis] = std::max({of(0), of(1), of(2)});
    if (!(lo[axis] > -max_coordinate && hi[axis] < max_coordinate)) return texel(num_levels() - 1, 0, 0);
  }
  const bool nearest = texture_.nearest != 0;
  const Reach reach_x(lo[0], hi[0], nearest), reach_y(lo[1], hi[1], nearest);
  // The finest level of which the triangle covers few cells.
  const auto num_cells = [&](uint32_t level) {
    return ((reach_x.num_texels() >> level) + 1) * ((reach_y.num_texels() >> level) + 1);
  };
  uint32_t level = 0;
  while (level + 1 < num_levels() && num_cells(level) > max_cells) ++level;
  std::vector<Span> columns, rows;
  if (!find_spans(reach_x, texture_.width, texture_.wrap_u, level, columns) ||
      !find_spans(reach_y, texture_.height, texture_.wrap_v, level, rows) ||
      columns.size() * rows.size() > 4 * max_cells)
    return texel(num_levels() - 1, 0, 0);

  // Cells that the triangle touches count a little whatever its part of them, so that none is lost where it is as thin as
  // roundings, and those of a line count alike.
  const double extent = (hi[0] - lo[0]) * (hi[1] - lo[1]), least = extent > 0 ? 0x1p-20 * extent : 1;
  double sum[3] = {0, 0, 0}, weight_sum = 0;
  for (const Span &row : rows) {
    const Polygon band = cut<&Point::y>(cut<&Point::y>(triangle, row.lo, 1), row.hi, -1);
    for (const Span &column : columns) {
      const Polygon part = cut<&Point::x>(cut<&Point::x>(band, column.lo, 1), column.hi, -1);
      if (part.size == 0) continue;
      const double weight = area(part) + least;
      const Vec3f t = texel(level, column.cell, row.cell);
      weight_sum += weight;
      for (int c = 0; c < 3; ++c) sum[c] += weight * double(at(t, c));
    }
  }
  const double scale = 1 / weight_sum;
  return {rounded(sum[0] * scale), rounded(sum[1] * scale), rounded(sum[2] * scale)};
}

}  // namespace gpurt
