// Row 25 of the failure catalogue: the noise of pictures with other seeds, or other frames, has nothing in common.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

namespace gpurt_test {

/// Red of each pixel less its mean, of length 1.
inline std::vector<double> unit_noise(const std::vector<float> &color)
{
  std::vector<double> values;
  for (size_t i = 0; i < color.size(); i += 3) values.push_back(double(color[i]));
  double sum = 0, square = 0;
  for (double v : values) sum += v;
  for (double &v : values) v -= sum / double(values.size()), square += v * v;
  for (double &v : values) v /= std::sqrt(square);
  EXPECT_GT(square, 0) << "no noise to compare";
  return values;
}

struct Correlations {
  uint64_t num_pairs = 0, num_bad = 0;
  double worst_sigma = 0;
};

/// Of n independent values the correlation has the standard deviation 1/sqrt(n): 3 of them are allowed.
inline Correlations correlate(const std::vector<std::vector<double>> &noise)
{
  Correlations c;
  const double sigma = 1 / std::sqrt(double(noise[0].size()));
  for (size_t i = 0; i < noise.size(); ++i) {
    for (size_t j = i + 1; j < noise.size(); ++j) {
      double correlation = 0;
      for (size_t k = 0; k < noise[i].size(); ++k) correlation += noise[i][k] * noise[j][k];
      c.worst_sigma = std::max(c.worst_sigma, std::abs(correlation) / sigma);
      c.num_bad += !(std::abs(correlation) < 3 * sigma);
      ++c.num_pairs;
    }
  }
  return c;
}

}  // namespace gpurt_test
