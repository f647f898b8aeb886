// Photon maps: building, gathers within a radius that holds about 50, and the 50 nearest, on even sets, on surfaces, and
// on surfaces with a caustic. One JSON line a case.
//
//   bench_photons [--device cpu|cuda] [--points N]... [--queries N] [--set NAME]... [--repeats N] [--threads N]
//                 [--most-lists N]
//
// Sets: uniform (the unit cube), surface (64 spheres, even by area), caustic (the same; half of the points and of the
// queries in a cap of a thousandth of the area, with a radius for the cap), caustic-wide (with a radius such that the
// background holds 10). Queries are drawn like the points, in random order. Times of queries are those of batches that
// are queued one after another, sorting included; on the CPU, of single calls.
//
// Structures that are compared: the grid; a pyramid of grids, for nearest points; and the talk's lists of the photons
// within the radius of a kd-tree's leaves, which the host makes, for up to --most-lists points (1000000).
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "check.h"
#include "gpurt_cuda.h"

namespace {

using Vec = std::array<float, 3>;

// A counter-based generator: points are the same for any number of threads.
struct Random {
  uint64_t state;
  double next()
  {
    state += 0x9e3779b97f4a7c15u;
    uint64_t z = state;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return double((z ^ z >> 31) >> 11) * 0x1p-53;
  }
};

struct Points {
  std::vector<Vec> positions, normals, fluxes;
};

struct Sphere {
  double center[3], radius;
};

std::vector<Sphere> spheres()
{
  Random random{77};
  std::vector<Sphere> all(64);
  for (Sphere &s : all) {
    for (double &c : s.center) c = random.next();
    s.radius = 0.03 + 0.12 * random.next();
  }
  return all;
}

void on_sphere(const Sphere &s, double z, double phi, Vec &position, Vec &normal)
{
  const double r = std::sqrt(std::max(0.0, 1 - z * z));
  const double n[3] = {r * std::cos(phi), r * std::sin(phi), z};
  for (int k = 0; k < 3; ++k) {
    normal[k] = float(n[k]);
    position[k] = float(s.center[k] + s.radius * n[k]);
  }
}

Points make_points(const std::string &set, uint64_t n, uint64_t seed)
{
  Points points;
  points.positions.resize(n);
  points.normals.resize(n);
  points.fluxes.resize(n);
  const std::vector<Sphere> all = spheres();
  std::vector<double> area;
  double sum = 0;
  for (const Sphere &s : all) area.push_back(sum += s.radius * s.radius);
  // The cap of the largest sphere whose area is a thousandth of the whole: 2 pi r^2 (1 - cos) of 4 pi sum.
  const auto largest =
      std::max_element(all.begin(), all.end(), [](auto &a, auto &b) { return a.radius < b.radius; });
  const double cap = 0.001 * 2 * sum / (largest->radius * largest->radius);
  const auto fill = [&](uint64_t begin, uint64_t end) {
    for (uint64_t i = begin; i < end; ++i) {
      Random random{(seed << 40) + i * 16};
      random.next();
      const double a = random.next(), b = random.next(), c = random.next();
      if (set == "uniform") {
        points.positions[i] = {float(a), float(b), float(c)};
        Vec unused;
        on_sphere(all[0], 2 * random.next() - 1, 6.283185307 * random.next(), unused, points.normals[i]);
      } else if (set != "surface" && random.next() < 0.5) {
        on_sphere(*largest, 1 - cap * a, 6.283185307 * b, points.positions[i], points.normals[i]);
      } else {
        const size_t s = size_t(std::lower_bound(area.begin(), area.end(), c * sum) - area.begin());
        on_sphere(all[std::min(s, all.size() - 1)], 2 * a - 1, 6.283185307 * b, points.positions[i],
                  points.normals[i]);
      }
      points.fluxes[i] = {float(random.next()), float(random.next()), float(random.next())};
    }
  };
  std::vector<std::thread> threads;
  const unsigned num = std::max(1u, std::thread::hardware_concurrency());
  for (unsigned t = 0; t < num; ++t) threads.emplace_back(fill, n * t / num, n * (t + 1) / num);
  for (std::thread &t : threads) t.join();
  return points;
}

// A radius that holds about 50 points, or of caustics what is said above.
double radius_of(const std::string &set, uint64_t n)
{
  if (set == "uniform") return std::cbrt(50 / (double(n) * 4.18879));
  double area = 0;
  for (const Sphere &s : spheres()) area += 12.566371 * s.radius * s.radius;
  // pi r^2 of the area that the points share.
  const auto holds = [&](double count, double share, double part) {
    return std::sqrt(count * area * part / (3.14159265 * double(n) * share));
  };
  if (set == "surface") return holds(50, 1, 1);
  if (set == "caustic") return holds(100, 0.5, 0.001);
  return holds(10, 0.5, 1);
}

struct Options {
  bool is_cuda = true;
  std::vector<uint64_t> points;
  std::vector<std::string> sets;
  uint64_t queries = 1000000, most_lists = 1000000;
  uint32_t repeats = 5, threads = 0;
};

// An array where the device has it at hand.
class Array {
 public:
  Array(gpurt_device device, uint64_t bytes, const void *data = nullptr)
  {
    gpurt_buffer_desc desc = GPURT_BUFFER_DESC_INIT;
    desc.storage = GPURT_STORAGE_DEVICE;
    desc.size_bytes = bytes;
    check(gpurt_buffer_create(device, &desc, &buffer_), "gpurt_buffer_create");
    if (data) check(gpurt_buffer_write(buffer_, 0, data, bytes), "gpurt_buffer_write");
    check(gpurt_buffer_get_data(buffer_, &data_, &bytes), "gpurt_buffer_get_data");
  }
  Array(const Array &) = delete;
  ~Array() { gpurt_buffer_release(buffer_); }
  float *floats() const { return static_cast<float *>(data_); }
  uint32_t *words() const { return static_cast<uint32_t *>(data_); }
  template <class T>
  std::vector<T> read(uint64_t count) const
  {
    std::vector<T> values(count);
    check(gpurt_buffer_read(buffer_, 0, values.data(), count * sizeof(T)), "gpurt_buffer_read");
    return values;
  }

 private:
  gpurt_buffer buffer_ = nullptr;
  void *data_ = nullptr;
};

class Bench {
 public:
  explicit Bench(const Options &options) : options_(options)
  {
    gpurt_device_desc desc = GPURT_DEVICE_DESC_INIT;
    desc.type = options.is_cuda ? GPURT_DEVICE_CUDA : GPURT_DEVICE_CPU;
    desc.num_threads = options.threads;
    check(gpurt_device_create(&desc, &device_), "gpurt_device_create");
    check(gpurt_device_get_properties(device_, &properties_), "gpurt_device_get_properties");
  }
  Bench(const Bench &) = delete;
  ~Bench() { gpurt_device_release(device_); }

  void run(const std::string &set, uint64_t n)
  {
    set_ = set;
    num_points_ = n;
    const float radius = float(radius_of(set, n));
    const Points points = make_points(set, n, 1), queries = make_points(set, options_.queries, 2);
    const Array positions(device_, n * 12, points.positions.data()),
        fluxes(device_, n * 12, points.fluxes.data()), normals(device_, n * 12, points.normals.data());
    const uint64_t q = options_.queries;
    const Array places(device_, q * 12, queries.positions.data()),
        directions(device_, q * 12, queries.normals.data());
    const Array counts(device_, q * 4), sums(device_, q * 12), ids(device_, q * 50 * 4),
        distances(device_, q * 50 * 4);

    gpurt_photon_map_desc d = GPURT_PHOTON_MAP_DESC_INIT;
    d.storage = GPURT_STORAGE_DEVICE;
    d.num_points = n;
    d.positions = positions.floats();
    d.radius = radius;
    gpurt_photon_map bare = build(d, "build of positions"), full = nullptr, levels = nullptr;
    d.fluxes = fluxes.floats();
    d.normals = normals.floats();
    full = build(d, "build of positions, fluxes and normals");
    d.fluxes = d.normals = nullptr;
    d.num_levels = 4;
    levels = build(d, "build of 4 levels of positions");

    gpurt_photon_query_desc query = GPURT_PHOTON_QUERY_DESC_INIT;
    query.storage = GPURT_STORAGE_DEVICE;
    query.num_queries = q;
    query.positions = places.floats();
    query.radius = radius;
    query.counts = counts.words();
    ask(bare, query, "count", counts);
    query.query = GPURT_PHOTON_QUERY_SUM;
    query.kernel = GPURT_GATHER_KERNEL_QUADRATIC;
    query.sums = sums.floats();
    ask(full, query, "flux", counts);
    query.coherence = GPURT_COHERENCE_COHERENT;
    ask(full, query, "flux, random order", counts);
    query.coherence = GPURT_COHERENCE_AUTO;
    query.normals = directions.floats();
    query.min_cosine = 0.5f;
    ask(full, query, "flux of like normals", counts);
    if (n <= options_.most_lists) compare_lists(full, query, counts);

    query = GPURT_PHOTON_QUERY_DESC_INIT;
    query.query = GPURT_PHOTON_QUERY_NEAREST;
    query.storage = GPURT_STORAGE_DEVICE;
    query.num_queries = q;
    query.positions = places.floats();
    query.counts = counts.words();
    query.ids = ids.words();
    query.distances = distances.floats();
    query.k = 50;
    if (set != "caustic-wide") {
      query.radius = 1.2f * radius;
      for (const float hint : {1.0f, 1.1f, 1.2f}) {
        char what[64];
        std::snprintf(what, sizeof what, "50 nearest within 1.2 r, hint %.1f r", hint);
        query.radius_hint = hint * radius;
        ask(bare, query, what, counts);
      }
      query.coherence = GPURT_COHERENCE_COHERENT;
      ask(bare, query, "50 nearest within 1.2 r, hint 1.2 r, random order", counts);
      query.coherence = GPURT_COHERENCE_AUTO;
      query.radius = 0;
      ask(levels, query, "50 nearest, hint 1.2 r, 4 levels", counts);
    }
    query.radius = query.radius_hint = 0;
    ask(levels, query, "50 nearest, no hint, 4 levels", counts);
    for (gpurt_photon_map map : {bare, full, levels}) gpurt_photon_map_release(map);
  }

  // The lists of a kd-tree's nodes beside the grid. They do not work on streams, so both take calls that wait.
  void compare_lists(gpurt_photon_map map, gpurt_photon_query_desc query, const Array &counts)
  {
    const double start = now();
    query.method = GPURT_GATHER_NODE_LISTS;
    check(gpurt_photon_map_query(map, &query), "gpurt_photon_map_query");
    // The first query makes them.
    print("build of node lists", {now() - start}, double(num_points_) / (now() - start), "");
    for (const bool has_normals : {true, false}) {
      if (!has_normals) query.normals = nullptr;
      for (const gpurt_gather_method method : {GPURT_GATHER_GRID, GPURT_GATHER_NODE_LISTS}) {
        query.method = method;
        const std::string what = std::string(has_normals ? "flux of like normals" : "flux") + ", call, " +
                                 (method == GPURT_GATHER_GRID ? "grid" : "node lists");
        ask(map, query, what.c_str(), counts, true);
      }
    }
  }

  // What kernels take of a multiprocessor.
  void list_kernels() const
  {
    uint32_t count = 0;
    if (!options_.is_cuda) return;
    check(gpurt_cuda_get_kernels(device_, nullptr, 0, &count), "gpurt_cuda_get_kernels");
    std::vector<gpurt_cuda_kernel> kernels(count);
    check(gpurt_cuda_get_kernels(device_, kernels.data(), count, &count), "gpurt_cuda_get_kernels");
    for (const gpurt_cuda_kernel &k : kernels) {
      std::printf(
          "{\"bench\":\"photons\",\"kernel\":\"%s\",\"registers\":%u,\"local_bytes\":%u,\"shared_bytes\":%u,"
          "\"occupancy\":%.3f}\n",
          k.name, k.registers, k.local_bytes, k.shared_bytes, k.occupancy);
    }
  }

 private:
  void print(const char *what, const std::vector<double> &seconds, double per_second,
             const std::string &more) const
  {
    std::printf(
        "{\"bench\":\"photons\",\"device\":\"%s\",\"threads\":%u,\"set\":\"%s\",\"points\":%llu,\"case\":\"%"
        "s\","
        "\"median_ms\":%.4f,\"least_ms\":%.4f,\"most_ms\":%.4f,\"million_per_s\":%.2f%s}\n",
        properties_.name, properties_.num_threads, set_.c_str(), (unsigned long long)num_points_, what,
        seconds[seconds.size() / 2] * 1e3, seconds.front() * 1e3, seconds.back() * 1e3, per_second * 1e-6,
        more.c_str());
    std::fflush(stdout);
  }

  gpurt_photon_map build(const gpurt_photon_map_desc &desc, const char *what)
  {
    std::vector<double> seconds;
    gpurt_photon_map map = nullptr;
    double wall = 0;
    gpurt_photon_map_info info = GPURT_PHOTON_MAP_INFO_INIT;
    for (uint32_t i = 0; i <= options_.repeats; ++i) {
      if (map) gpurt_photon_map_release(map);
      const double start = now();
      check(gpurt_photon_map_create(device_, &desc, &map), "gpurt_photon_map_create");
      wall = now() - start;
      check(gpurt_photon_map_get_info(map, &info), "gpurt_photon_map_get_info");
      if (i != 0) seconds.push_back(info.build_seconds);
    }
    std::sort(seconds.begin(), seconds.end());
    char more[256];
    std::snprintf(more, sizeof more,
                  ",\"radius\":%g,\"wall_ms\":%.3f,\"memory_bytes\":%llu,\"fullest_cell\":%u", desc.radius,
                  wall * 1e3, (unsigned long long)info.memory_bytes, info.fullest_cell);
    print(what, seconds, double(num_points_) / seconds[seconds.size() / 2], more);
    return map;
  }

  void ask(gpurt_photon_map map, const gpurt_photon_query_desc &query, const char *what, const Array &counts,
           bool waits = false)
  {
    std::vector<double> seconds;
    const bool is_queued = options_.is_cuda && !waits;
    const uint32_t batches = is_queued ? 4 : 1;
    for (uint32_t i = 0; i <= options_.repeats; ++i) {
      const double start = now();
      if (is_queued) {
        for (uint32_t b = 0; b < batches; ++b)
          check(gpurt_cuda_query_photons(map, &query, nullptr, nullptr, nullptr), "gpurt_cuda_query_photons");
        check(gpurt_cuda_wait(device_, properties_.ordinal, nullptr), "gpurt_cuda_wait");
      } else {
        check(gpurt_photon_map_query(map, &query), "gpurt_photon_map_query");
      }
      if (i != 0) seconds.push_back((now() - start) / batches);
    }
    std::sort(seconds.begin(), seconds.end());
    double found = 0;
    for (const uint32_t c : counts.read<uint32_t>(query.num_queries)) found += c;
    char more[64];
    std::snprintf(more, sizeof more, ",\"found\":%.2f", found / double(query.num_queries));
    print(what, seconds, double(query.num_queries) / seconds[seconds.size() / 2], more);
  }

  const Options &options_;
  gpurt_device device_ = nullptr;
  gpurt_device_properties properties_ = GPURT_DEVICE_PROPERTIES_INIT;
  std::string set_;
  uint64_t num_points_ = 0;
};

Options parse(int argc, char **argv)
{
  Options options;
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string name = argv[i], value = argv[i + 1];
    if (name == "--device") options.is_cuda = value == "cuda";
    else if (name == "--points") options.points.push_back(std::strtoull(value.c_str(), nullptr, 10));
    else if (name == "--queries") options.queries = std::strtoull(value.c_str(), nullptr, 10);
    else if (name == "--most-lists") options.most_lists = std::strtoull(value.c_str(), nullptr, 10);
    else if (name == "--set") options.sets.push_back(value);
    else if (name == "--repeats") options.repeats = uint32_t(std::max(1, std::atoi(value.c_str())));
    else if (name == "--threads") options.threads = uint32_t(std::atoi(value.c_str()));
    else {
      std::fprintf(stderr, "error: unknown option %s\n", name.c_str());
      std::exit(2);
    }
  }
  if (options.points.empty()) options.points = {1000000, 10000000};
  if (options.sets.empty()) options.sets = {"uniform", "surface", "caustic", "caustic-wide"};
  return options;
}

}  // namespace

int main(int argc, char **argv)
{
  const Options options = parse(argc, argv);
  Bench bench(options);
  for (const std::string &set : options.sets) {
    for (const uint64_t n : options.points) bench.run(set, n);
  }
  bench.list_kernels();
}
