// Gathers by nanoflann's kd-tree, for bench/compare_photon_maps.py: builds it over points, counts those within a radius of
// places, and prints the times as one JSON line.
//
//   bench_nanoflann POINTS PLACES RADIUS THREADS REPEATS
//
// Files of float32 [n][3]. The tree is built by one thread, as this version of nanoflann can; queries run on all.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <nanoflann.hpp>
#include <string>
#include <thread>
#include <vector>

namespace {

struct Points {
  std::vector<float> values;
  size_t kdtree_get_point_count() const { return values.size() / 3; }
  float kdtree_get_pt(size_t i, size_t axis) const { return values[3 * i + axis]; }
  template <class Box>
  bool kdtree_get_bbox(Box &) const
  {
    return false;
  }
};

using Tree =
    nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, Points>, Points, 3, uint32_t>;

// Counts, and keeps nothing.
struct Counter {
  float radius2;
  size_t count = 0;
  size_t size() const { return count; }
  bool full() const { return true; }
  bool addPoint(float distance2, uint32_t)
  {
    count += distance2 < radius2;
    return true;
  }
  float worstDist() const { return radius2; }
};

std::vector<float> read(const char *path)
{
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  std::vector<float> values(file ? size_t(file.tellg()) / sizeof(float) : 0);
  file.seekg(0);
  if (values.empty() ||
      !file.read(reinterpret_cast<char *>(values.data()), std::streamsize(values.size() * sizeof(float)))) {
    std::fprintf(stderr, "error: %s cannot be read\n", path);
    std::exit(1);
  }
  return values;
}

double seconds()
{
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace

int main(int argc, char **argv)
{
  if (argc != 6) {
    std::fprintf(stderr, "usage: bench_nanoflann POINTS PLACES RADIUS THREADS REPEATS\n");
    return 2;
  }
  const Points points{read(argv[1])};
  const std::vector<float> places = read(argv[2]);
  const float radius = std::strtof(argv[3], nullptr);
  const size_t num_places = places.size() / 3;
  const int num_threads = std::max(1, std::atoi(argv[4])), repeats = std::max(1, std::atoi(argv[5]));
  double build = 1e30, gather = 1e30;
  uint64_t found = 0;
  for (int i = 0; i < repeats; ++i) {
    double start = seconds();
    const auto tree = std::make_unique<Tree>(3, points, nanoflann::KDTreeSingleIndexAdaptorParams(10));
    tree->buildIndex();
    build = std::min(build, seconds() - start);
    start = seconds();
    std::atomic<size_t> next{0};
    std::atomic<uint64_t> sum{0};
    std::vector<std::thread> threads;
    for (int t = 0; t < num_threads; ++t) {
      threads.emplace_back([&] {
        uint64_t own = 0;
        constexpr size_t block = 1024;
        for (size_t first; (first = next.fetch_add(block)) < num_places;) {
          for (size_t k = first; k < std::min(first + block, num_places); ++k) {
            Counter counter{radius * radius};
            tree->findNeighbors(counter, places.data() + 3 * k, nanoflann::SearchParams());
            own += counter.count;
          }
        }
        sum += own;
      });
    }
    for (std::thread &t : threads) t.join();
    gather = std::min(gather, seconds() - start);
    found = sum;
  }
  std::printf("{\"build_s\":%.4f,\"gather_s\":%.4f,\"found\":%llu}\n", build, gather,
              static_cast<unsigned long long>(found));
}
