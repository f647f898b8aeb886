#include "mesh.h"

#include <algorithm>
#include <map>

namespace cli::scenes {

Vec3 transform_point(const Matrix &t, Vec3 p)
{
  const Vec3 v = transform_vector(t, p);
  return {v.x + t.m[0][3], v.y + t.m[1][3], v.z + t.m[2][3]};
}

Vec3 transform_vector(const Matrix &t, Vec3 v)
{
  const auto row = [&](int r) { return t.m[r][0] * v.x + t.m[r][1] * v.y + t.m[r][2] * v.z; };
  return {row(0), row(1), row(2)};
}

Matrix translation(Vec3 t) { return {{{1, 0, 0, t.x}, {0, 1, 0, t.y}, {0, 0, 1, t.z}}}; }
Matrix scaling(Vec3 s) { return {{{s.x, 0, 0, 0}, {0, s.y, 0, 0}, {0, 0, s.z, 0}}}; }

Matrix rotation(Vec3 axis, double angle_rad)
{
  const Vec3 a = normalize(axis);
  const double c = std::cos(angle_rad), s = std::sin(angle_rad), d = 1 - c;
  return {{{a.x * a.x * d + c, a.x * a.y * d - a.z * s, a.x * a.z * d + a.y * s, 0},
           {a.y * a.x * d + a.z * s, a.y * a.y * d + c, a.y * a.z * d - a.x * s, 0},
           {a.z * a.x * d - a.y * s, a.z * a.y * d + a.x * s, a.z * a.z * d + c, 0}}};
}

Matrix operator*(const Matrix &a, const Matrix &b)
{
  Matrix product;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 4; ++c) {
      product.m[r][c] = c == 3 ? a.m[r][3] : 0;
      for (int k = 0; k < 3; ++k) product.m[r][c] += a.m[r][k] * b.m[k][c];
    }
  }
  return product;
}

Matrix look_at(Vec3 eye, Vec3 target, Vec3 up)
{
  const Vec3 z = normalize(eye - target), x = normalize(cross(up, z)), y = cross(z, x);
  return {{{x.x, y.x, z.x, eye.x}, {x.y, y.y, z.y, eye.y}, {x.z, y.z, z.z, eye.z}}};
}

void Mesh::add_quad(Vec3 a, Vec3 b, Vec3 c, Vec3 d)
{
  const auto first = uint32_t(positions.size());
  positions.insert(positions.end(), {a, b, c, d});
  uvs.insert(uvs.end(), {{0, 1}, {1, 1}, {1, 0}, {0, 0}});
  triangles.push_back({first, first + 1, first + 2});
  triangles.push_back({first, first + 2, first + 3});
}

void Mesh::append(const Mesh &other, const Matrix &matrix)
{
  const auto first = uint32_t(positions.size());
  for (Vec3 p : other.positions) positions.push_back(transform_point(matrix, p));
  // Rotations and uniform scales alone are used here, so normals turn like vectors.
  for (Vec3 n : other.normals) normals.push_back(normalize(transform_vector(matrix, n)));
  uvs.insert(uvs.end(), other.uvs.begin(), other.uvs.end());
  for (const auto &t : other.triangles) triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
}

Mesh quad(Vec3 a, Vec3 b, Vec3 c, Vec3 d)
{
  Mesh mesh;
  mesh.add_quad(a, b, c, d);
  return mesh;
}

Mesh box(Vec3 lo, Vec3 hi)
{
  const auto corner = [&](int i) {
    return Vec3{i & 1 ? hi.x : lo.x, i & 2 ? hi.y : lo.y, i & 4 ? hi.z : lo.z};
  };
  Mesh mesh;
  for (const auto &f : {std::array{0, 4, 6, 2}, std::array{1, 3, 7, 5}, std::array{0, 1, 5, 4},
                        std::array{2, 6, 7, 3}, std::array{0, 2, 3, 1}, std::array{4, 5, 7, 6}}) {
    mesh.add_quad(corner(f[0]), corner(f[1]), corner(f[2]), corner(f[3]));
  }
  return mesh;
}

Mesh icosphere(int subdivisions, bool smooth)
{
  const double t = (1 + std::sqrt(5.0)) / 2;
  Mesh mesh;
  mesh.positions = {{-1, t, 0},  {1, t, 0},  {-1, -t, 0}, {1, -t, 0}, {0, -1, t},  {0, 1, t},
                    {0, -1, -t}, {0, 1, -t}, {t, 0, -1},  {t, 0, 1},  {-t, 0, -1}, {-t, 0, 1}};
  for (Vec3 &p : mesh.positions) p = normalize(p);
  mesh.triangles = {{0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
                    {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
                    {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
  for (int level = 0; level < subdivisions; ++level) {
    std::map<std::pair<uint32_t, uint32_t>, uint32_t> middles;  // shared, so that the mesh stays closed
    const auto middle = [&](uint32_t a, uint32_t b) {
      const auto [entry, is_new] = middles.try_emplace(std::minmax(a, b), uint32_t(mesh.positions.size()));
      if (is_new) mesh.positions.push_back(normalize(mesh.positions[a] + mesh.positions[b]));
      return entry->second;
    };
    std::vector<std::array<uint32_t, 3>> finer;
    for (const auto &[a, b, c] : mesh.triangles) {
      const uint32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {b, bc, ab}, {c, ca, bc}, {ab, bc, ca}});
    }
    mesh.triangles = std::move(finer);
  }
  if (smooth) mesh.normals = mesh.positions;
  return mesh;
}

Mesh lathe(const std::vector<std::array<double, 2>> &profile, int segments)
{
  Mesh mesh;
  const size_t n = profile.size();
  // Normal of each piece of the profile, to its right when it is walked from bottom to top.
  std::vector<std::array<double, 2>> piece(n - 1);
  for (size_t i = 0; i + 1 < n; ++i) {
    const double dr = profile[i + 1][0] - profile[i][0], dy = profile[i + 1][1] - profile[i][1],
                 l = std::hypot(dr, dy);
    piece[i] = {dy / l, -dr / l};
  }
  const auto corner_normal = [&](size_t point, size_t of_piece) {
    const size_t other = point == of_piece ? of_piece - 1 : of_piece + 1;
    if (other >= piece.size()) return piece[of_piece];
    const auto &a = piece[of_piece], &b = piece[other];
    if (a[0] * b[0] + a[1] * b[1] < std::cos(40 * pi / 180)) return a;
    return std::array{a[0] + b[0], a[1] + b[1]};
  };
  for (size_t i = 0; i + 1 < n; ++i) {
    const auto first = uint32_t(mesh.positions.size());
    for (int s = 0; s <= segments; ++s) {
      // The last column repeats the first one's positions exactly: the seam stays closed.
      const double phi = 2 * pi * (s % segments) / segments, c = std::cos(phi), d = std::sin(phi);
      for (size_t end = 0; end < 2; ++end) {
        const auto normal = corner_normal(i + end, i);
        mesh.positions.push_back({profile[i + end][0] * c, profile[i + end][1], -profile[i + end][0] * d});
        mesh.normals.push_back(normalize({normal[0] * c, normal[1], -normal[0] * d}));
        mesh.uvs.push_back({double(s) / segments, double(i + end) / double(n - 1)});
      }
    }
    for (uint32_t s = 0; s < uint32_t(segments); ++s) {
      const uint32_t a = first + 2 * s, b = a + 2, c = a + 3, d = a + 1;
      if (profile[i][0] > 0) mesh.triangles.push_back({a, b, c});
      if (profile[i + 1][0] > 0) mesh.triangles.push_back({a, c, d});
    }
  }
  return mesh;
}

Mesh tube(const std::vector<Vec3> &path, const std::vector<double> &radii, int sides)
{
  Mesh mesh;
  Vec3 side = std::abs(normalize(path[1] - path[0]).y) > 0.9 ? Vec3{1, 0, 0} : Vec3{0, 1, 0};
  double along = 0;
  for (size_t i = 0; i < path.size(); ++i) {
    if (i > 0) along += length(path[i] - path[i - 1]);
    const Vec3 forward = normalize(path[std::min(i + 1, path.size() - 1)] - path[i > 0 ? i - 1 : 0]);
    // The frame is carried along, so that the tube does not twist.
    const Vec3 u = normalize(side - forward * dot(side, forward)), v = cross(forward, u);
    side = u;
    for (int s = 0; s <= sides; ++s) {
      const double phi = 2 * pi * (s % sides) / sides;
      const Vec3 normal = u * std::cos(phi) + v * std::sin(phi);
      mesh.positions.push_back(path[i] + normal * radii[i]);
      mesh.normals.push_back(normal);
      mesh.uvs.push_back({double(s) / sides, along});
    }
  }
  const auto ring = uint32_t(sides + 1);
  for (uint32_t i = 0; i + 1 < path.size(); ++i) {
    for (uint32_t s = 0; s < uint32_t(sides); ++s) {
      const uint32_t a = i * ring + s, b = a + 1, c = b + ring, d = a + ring;
      mesh.triangles.push_back({a, b, c});
      mesh.triangles.push_back({a, c, d});
    }
  }
  return mesh;
}

Mesh height_field(double x0, double z0, double x1, double z1, int n,
                  const std::function<double(double, double)> &height)
{
  Mesh mesh;
  const double dx = (x1 - x0) / n, dz = (z1 - z0) / n;
  for (int j = 0; j <= n; ++j) {
    for (int i = 0; i <= n; ++i) {
      const double x = x0 + i * dx, z = z0 + j * dz;
      mesh.positions.push_back({x, height(x, z), z});
      mesh.normals.push_back(
          normalize({height(x - dx, z) - height(x + dx, z), 2 * dx, height(x, z - dz) - height(x, z + dz)}));
      mesh.uvs.push_back({double(i) / n, double(j) / n});
    }
  }
  const auto row = uint32_t(n + 1);
  for (uint32_t j = 0; j < uint32_t(n); ++j) {
    for (uint32_t i = 0; i < uint32_t(n); ++i) {
      const uint32_t a = j * row + i, b = a + row, c = b + 1, d = a + 1;
      mesh.triangles.push_back({a, b, c});
      mesh.triangles.push_back({a, c, d});
    }
  }
  return mesh;
}

Mesh part_of(const Mesh &mesh, const std::function<bool(Vec3)> &is_in)
{
  constexpr uint32_t unused = 0xffffffff;
  std::vector<uint32_t> place(mesh.positions.size(), unused);
  Mesh part;
  for (std::array<uint32_t, 3> t : mesh.triangles) {
    if (!is_in(mesh.positions[t[0]])) continue;
    for (uint32_t &v : t) {
      if (place[v] == unused) {
        place[v] = uint32_t(part.positions.size());
        part.positions.push_back(mesh.positions[v]);
        if (!mesh.normals.empty()) part.normals.push_back(mesh.normals[v]);
        if (!mesh.uvs.empty()) part.uvs.push_back(mesh.uvs[v]);
      }
      v = place[v];
    }
    part.triangles.push_back(t);
  }
  return part;
}

namespace {

uint64_t mix_bits(uint64_t x)
{
  x = (x ^ x >> 30) * 0xbf58476d1ce4e5b9u;
  x = (x ^ x >> 27) * 0x94d049bb133111ebu;
  return x ^ x >> 31;
}

// A value in [-1, 1] for a corner of the lattice.
double lattice(int64_t x, int64_t y, int64_t z, uint32_t seed)
{
  const uint64_t h = mix_bits(uint64_t(x) * 0x9e3779b97f4a7c15u + uint64_t(y) * 0xc2b2ae3d27d4eb4fu +
                              uint64_t(z) * 0x165667b19e3779f9u + seed * 0xd6e8feb86659fd93u);
  return double(h >> 11) * 0x1p-52 - 1;
}

}  // namespace

double noise(Vec3 p, uint32_t seed)
{
  const double fx = std::floor(p.x), fy = std::floor(p.y), fz = std::floor(p.z);
  const auto fade = [](double t) { return t * t * t * (t * (t * 6 - 15) + 10); };
  const double tx = fade(p.x - fx), ty = fade(p.y - fy), tz = fade(p.z - fz);
  double sum = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const int cx = corner & 1, cy = corner >> 1 & 1, cz = corner >> 2;
    const double weight = (cx ? tx : 1 - tx) * (cy ? ty : 1 - ty) * (cz ? tz : 1 - tz);
    sum += weight * lattice(int64_t(fx) + cx, int64_t(fy) + cy, int64_t(fz) + cz, seed);
  }
  return sum;
}

double fractal_noise(Vec3 p, int octaves, uint32_t seed)
{
  double sum = 0, scale = 1;
  for (int i = 0; i < octaves; ++i) {
    sum += noise(p, seed + uint32_t(i)) * scale;
    // Not quite doubled, so that the lattices of the octaves do not line up.
    p = p * 2.03 + Vec3{17.1, 3.7, 9.2};
    scale *= 0.5;
  }
  return sum;
}

double Sequence::next()
{
  state_ += 0x9e3779b97f4a7c15u;
  return double(mix_bits(state_) >> 11) * 0x1p-53;
}

}  // namespace cli::scenes
