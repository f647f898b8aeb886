#include "scene/affine.h"

#include "scene/rounding.h"

namespace gpurt {

AffineDouble to_double(const Transform &t)
{
  AffineDouble d;
  for (int i = 0; i < 12; ++i) d[i] = t.m[i / 4][i % 4];
  return d;
}

Transform to_float(const AffineDouble &t)
{
  Transform f;
  for (int i = 0; i < 12; ++i) f.m[i / 4][i % 4] = float(t[i]);
  return f;
}

bool is_finite(const AffineDouble &t)
{
  for (double x : t) {
    if (!std::isfinite(x)) return false;
  }
  return true;
}

AffineDouble multiply(const AffineDouble &a, const AffineDouble &b)
{
  AffineDouble c;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 4; ++j) {
      c[4 * i + j] =
          a[4 * i] * b[j] + a[4 * i + 1] * b[4 + j] + a[4 * i + 2] * b[8 + j] + (j == 3 ? a[4 * i + 3] : 0);
    }
  }
  return c;
}

Vec3d transform_point(const AffineDouble &t, Vec3d p)
{
  return {t[0] * p.x + t[1] * p.y + t[2] * p.z + t[3], t[4] * p.x + t[5] * p.y + t[6] * p.z + t[7],
          t[8] * p.x + t[9] * p.y + t[10] * p.z + t[11]};
}

Vec3d transform_vector(const AffineDouble &t, Vec3d v)
{
  return {t[0] * v.x + t[1] * v.y + t[2] * v.z, t[4] * v.x + t[5] * v.y + t[6] * v.z,
          t[8] * v.x + t[9] * v.y + t[10] * v.z};
}

double determinant(const AffineDouble &t)
{
  const double terms[6] = {t[0] * t[5] * t[10], t[1] * t[6] * t[8],   t[2] * t[4] * t[9],
                           -t[2] * t[5] * t[8], -t[1] * t[4] * t[10], -t[0] * t[6] * t[9]};
  double sum = 0, magnitude = 0;
  for (double term : terms) {
    sum += term;
    magnitude += std::fabs(term);
  }
  // Two roundings a term and at most five of the sum, each 2^-53 relative to the magnitude.
  return std::fabs(sum) <= magnitude * 0x1p-50 ? 0 : sum;
}

AffineDouble inverse(const AffineDouble &t)
{
  const double d = 1 / determinant(t);
  AffineDouble r;
  r[0] = (t[5] * t[10] - t[6] * t[9]) * d;
  r[1] = (t[2] * t[9] - t[1] * t[10]) * d;
  r[2] = (t[1] * t[6] - t[2] * t[5]) * d;
  r[4] = (t[6] * t[8] - t[4] * t[10]) * d;
  r[5] = (t[0] * t[10] - t[2] * t[8]) * d;
  r[6] = (t[2] * t[4] - t[0] * t[6]) * d;
  r[8] = (t[4] * t[9] - t[5] * t[8]) * d;
  r[9] = (t[1] * t[8] - t[0] * t[9]) * d;
  r[10] = (t[0] * t[5] - t[1] * t[4]) * d;
  for (int i = 0; i < 3; ++i) {
    r[4 * i + 3] = -(r[4 * i] * t[3] + r[4 * i + 1] * t[7] + r[4 * i + 2] * t[11]);
  }
  return r;
}

Vec3d transform_normal(const AffineDouble &inverse, Vec3d n)
{
  return {inverse[0] * n.x + inverse[4] * n.y + inverse[8] * n.z,
          inverse[1] * n.x + inverse[5] * n.y + inverse[9] * n.z,
          inverse[2] * n.x + inverse[6] * n.y + inverse[10] * n.z};
}

double largest_stretch(const AffineDouble &t)
{
  double scale = 0;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) scale = std::fmax(scale, std::fabs(t[4 * i + j]));
  if (scale == 0) return 0;
  double s[3][3];  // of the transpose times the map: its largest eigenvalue is the square
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      s[i][j] = 0;
      for (int k = 0; k < 3; ++k) s[i][j] += t[4 * k + i] / scale * (t[4 * k + j] / scale);
    }
  }
  // Jacobi's rotations. Source: Golub and Van Loan 2013, Section 8.5. Four sweeps leave nothing beside the diagonal.
  for (int sweep = 0; sweep < 6; ++sweep) {
    for (int p = 0; p < 2; ++p) {
      for (int q = p + 1; q < 3; ++q) {
        if (s[p][q] == 0) continue;
        const double theta = (s[q][q] - s[p][p]) / (2 * s[p][q]);
        const double tangent = (theta < 0 ? -1 : 1) / (std::fabs(theta) + std::sqrt(theta * theta + 1));
        const double c = 1 / std::sqrt(tangent * tangent + 1), d = tangent * c;
        for (int k = 0; k < 3; ++k) {
          const double a = s[k][p], b = s[k][q];
          s[k][p] = c * a - d * b;
          s[k][q] = d * a + c * b;
        }
        for (int k = 0; k < 3; ++k) {
          const double a = s[p][k], b = s[q][k];
          s[p][k] = c * a - d * b;
          s[q][k] = d * a + c * b;
        }
      }
    }
  }
  return scale * std::sqrt(std::fmax(s[0][0], std::fmax(s[1][1], s[2][2]))) * (1 + 0x1p-45);
}

Box transform_box(const AffineDouble &t, const Box &box)
{
  Box result = empty_box();
  if (is_empty(box)) return result;
  for (int i = 0; i < 3; ++i) {
    double lo = t[4 * i + 3], hi = lo, magnitude = std::fabs(lo);
    for (int j = 0; j < 3; ++j) {
      const double a = t[4 * i + j] * at(box.lo, j), b = t[4 * i + j] * at(box.hi, j);
      lo += std::fmin(a, b);
      hi += std::fmax(a, b);
      magnitude += std::fmax(std::fabs(a), std::fabs(b));
    }
    // Four roundings of 2^-53 each.
    set(result.lo, i, round_down(lo - magnitude * 0x1p-50));
    set(result.hi, i, round_up(hi + magnitude * 0x1p-50));
  }
  return result;
}

}  // namespace gpurt
