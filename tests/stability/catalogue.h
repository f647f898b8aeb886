// The failure catalogue: inputs where ray tracers fail, what is looked at, and what each method does there.
//
// Every test records its counts by row and method. A run of the program with GPURT_STABILITY_RESULTS=FILE appends them to
// FILE as CSV, from which scripts/stability makes docs/stability.md. GPURT_STABILITY_FULL=1 takes the counts that the
// catalogue names; without it there are fewer, so that the suite fits a CI run.
#pragma once

#include <cstdio>
#include <string>
#include <vector>

#include "../support/queries.h"
#include "../support/rays.h"

namespace gpurt_test {

/// A way to trace rays: a device, an accelerator and a triangle test.
struct Method {
  const char *name;
  gpurt_device_type device;
  gpurt_accel accel;
  gpurt_triangle_test test;

  bool is_cuda() const { return device == GPURT_DEVICE_CUDA; }
  bool is_kdtree() const { return accel == GPURT_ACCEL_KDTREE; }
  bool is_embree() const { return accel == GPURT_ACCEL_EMBREE; }
  /// The test whose every freedom is known: see exact_oracle.h.
  bool is_exact() const { return !is_embree() && test != GPURT_TRIANGLE_MOLLER_TRUMBORE; }
};
const std::vector<Method> &methods();
/// Photon mapping, on the devices that have it.
const std::vector<Method> &photon_methods();
/// REYES, on the devices that have it.
const std::vector<Method> &reyes_methods();
inline void PrintTo(const Method &method, std::ostream *out) { *out << method.name; }

enum class Expected {
  Pass,   // asserted
  Fails,  // known to fail, by arithmetic that is the same everywhere: asserted, so that a cure is noticed
  Varies  // known to fail, how often depends on a third party's version or on the count: counted
};

struct Expectation {
  Expected expected;
  const char *reason;  // why it fails
};

struct CatalogueRow {
  int number;
  const char *failure;
  const char *input;  // what this suite does, counts of a full run
  const char *criterion;
  const char *missing;  // why there is no test yet; NULL: there is
};
const std::vector<CatalogueRow> &catalogue();

/// What is known of a method at a row; Pass for what is not listed.
Expectation expectation(int row, const Method &method);

bool is_full_run();
/// The number of rays, triangles ... to take: in CI, or as the catalogue says.
inline uint64_t count(uint64_t in_ci, uint64_t full) { return is_full_run() ? full : in_ci; }

/// Writes a result down, prints it and asserts what is expected.
void record(int row, const Method &method, uint64_t failures, uint64_t trials, const std::string &note = "");

/// The fixture of all rows: skips methods that this build or machine does not have.
class Stability : public ::testing::TestWithParam<Method> {
 protected:
  void SetUp() override;

  const Method &method() const { return GetParam(); }
  Scene make_scene() const;
  Scene make_scene(const Mesh &mesh) const;
  void commit_scene(gpurt_scene scene) const { commit(scene, method().accel, method().test); }

  Device device_;
};

/// Traces `rays` and counts those whose hit is_bad(index, hit).
template <class F>
uint64_t count_hits(gpurt_scene scene, const std::vector<gpurt_ray> &rays, F &&is_bad)
{
  const std::vector<gpurt_hit> hits = trace_closest(scene, rays);
  uint64_t bad = 0;
  for (size_t i = 0; i < rays.size(); ++i) bad += is_bad(i, hits[i]) ? 1 : 0;
  return bad;
}

/// The same for `total` rays made by make(i), in batches.
template <class Make, class F>
uint64_t count_hits(gpurt_scene scene, uint64_t total, Make &&make, F &&is_bad)
{
  uint64_t bad = 0;
  std::vector<gpurt_ray> rays;
  for (uint64_t done = 0; done < total; done += rays.size()) {
    rays.resize(std::min<uint64_t>(total - done, 1 << 18));
    for (size_t i = 0; i < rays.size(); ++i) rays[i] = make(done + i);
    bad += count_hits(scene, rays, [&](size_t i, const gpurt_hit &hit) { return is_bad(rays[i], hit); });
  }
  return bad;
}

inline bool is_miss(const gpurt_hit &hit) { return hit.primitive == GPURT_INVALID_ID; }

/// A note with one number or two.
inline std::string text_of(const char *format, double a, double b = 0)
{
  char text[128];
  std::snprintf(text, sizeof text, format, a, b);
  return text;
}

#define GPURT_STABILITY_SUITE(Suite) \
  INSTANTIATE_TEST_SUITE_P(Methods, Suite, ::testing::ValuesIn(gpurt_test::methods()), \
                           [](const auto &info) { return std::string(info.param.name); })

}  // namespace gpurt_test
