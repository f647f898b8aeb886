// gpurt trace: a file of rays to a file of hits.
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>

#include "options.h"
#include "progress.h"

namespace cli {

namespace {

static_assert(sizeof(gpurt_ray) == 32 && sizeof(gpurt_hit) == 32, "the files hold these as they are");

struct TraceOptions {
  std::string scene, rays, output, offsets;
  std::string query = "closest";
  DeviceOptions device;
  BuildOptions build;
};

[[noreturn]] void fail_io(const std::string &path, const char *what)
{
  fail("{}: {}: {}", path, what, std::strerror(errno));
}

// A file being written under a temporary name; nothing is left of it unless commit() is reached.
class OutputFile {
 public:
  explicit OutputFile(std::string path)
      : path_(std::move(path)), temporary_(fmt::format("{}.tmp-{}", path_, ::getpid()))
  {
    file_ = std::fopen(temporary_.c_str(), "wb");
    if (!file_) fail_io(path_, "cannot be created");
  }
  ~OutputFile()
  {
    if (!file_) return;
    std::fclose(file_);
    std::remove(temporary_.c_str());
  }
  void write(const void *data, size_t bytes)
  {
    if (std::fwrite(data, 1, bytes, file_) != bytes) fail_io(path_, "cannot be written");
  }
  void commit()
  {
    std::FILE *file = std::exchange(file_, nullptr);
    if (std::fclose(file) == 0 && std::rename(temporary_.c_str(), path_.c_str()) == 0) return;
    const int error = errno;
    std::remove(temporary_.c_str());
    errno = error;
    fail_io(path_, "cannot be written");
  }

 private:
  std::string path_, temporary_;
  std::FILE *file_ = nullptr;
};

class RayFile {
 public:
  explicit RayFile(const std::string &path) : path_(path), file_(std::fopen(path.c_str(), "rb"))
  {
    if (!file_) fail_io(path_, "cannot be read");
    std::error_code error;
    if (std::filesystem::is_directory(path_, error)) fail("{}: is a folder, no file of rays", path_);
    if (::fseeko(file_, 0, SEEK_END) != 0) fail_io(path_, "cannot be read");
    const off_t bytes = ::ftello(file_);
    if (bytes < 0 || ::fseeko(file_, 0, SEEK_SET) != 0) fail_io(path_, "cannot be read");
    if (bytes % off_t(sizeof(gpurt_ray)) != 0) {
      fail(
          "{}: is no ray file: {} bytes are no multiple of 32; a ray is 8 float32: ox oy oz tmin dx dy dz "
          "tmax",
          path_, bytes);
    }
    count_ = uint64_t(bytes) / sizeof(gpurt_ray);
  }
  ~RayFile() { std::fclose(file_); }
  uint64_t count() const { return count_; }
  void read(gpurt_ray *rays, size_t n)
  {
    if (std::fread(rays, sizeof(gpurt_ray), n, file_) != n) fail_io(path_, "cannot be read");
  }

 private:
  const std::string &path_;
  std::FILE *file_;
  uint64_t count_ = 0;
};

// Traces a batch and writes it; returns the number of hits. `base` is the number of hits of earlier batches.
uint64_t trace_batch(gpurt_scene scene, gpurt_query query, const std::vector<gpurt_ray> &rays,
                     OutputFile &out, OutputFile *offsets_out, uint64_t base)
{
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.query = query;
  desc.num_rays = rays.size();
  desc.rays = rays.data();
  std::vector<gpurt_hit> hits;
  std::vector<uint8_t> occluded;
  std::vector<uint64_t> offsets;
  uint64_t num_hits = 0;
  if (query == GPURT_QUERY_ANY) {
    occluded.resize(rays.size());
    desc.occluded = occluded.data();
    check(gpurt_scene_trace(scene, &desc));
    for (uint8_t hit : occluded) num_hits += hit;
    out.write(occluded.data(), occluded.size());
  } else if (query == GPURT_QUERY_CLOSEST) {
    hits.resize(rays.size());
    desc.hits = hits.data();
    check(gpurt_scene_trace(scene, &desc));
    for (const gpurt_hit &hit : hits) num_hits += hit.primitive != GPURT_INVALID_ID;
    out.write(hits.data(), hits.size() * sizeof(gpurt_hit));
  } else {
    // Counted first, then filled.
    offsets.resize(rays.size() + 1);
    desc.offsets = offsets.data();
    check(gpurt_scene_trace(scene, &desc));
    num_hits = offsets.back();
    hits.resize(num_hits);
    desc.hits = hits.data();
    desc.hit_capacity = num_hits;
    if (num_hits > 0) check(gpurt_scene_trace(scene, &desc));
    out.write(hits.data(), hits.size() * sizeof(gpurt_hit));
    for (uint64_t &offset : offsets) offset += base;
    offsets_out->write(offsets.data(), rays.size() * sizeof(uint64_t));
  }
  return num_hits;
}

void run(const TraceOptions &o)
{
  const gpurt_query query = o.query == "any"   ? GPURT_QUERY_ANY
                            : o.query == "all" ? GPURT_QUERY_ALL
                                               : GPURT_QUERY_CLOSEST;
  if ((query == GPURT_QUERY_ALL) != !o.offsets.empty())
    fail_usage("--query all and --offsets FILE belong together");
  check_folder_of(o.output);
  if (!o.offsets.empty()) check_folder_of(o.offsets);
  RayFile rays(o.rays);
  const Device device = o.device.create();
  const Scene scene = load_scene(device, o.scene);
  commit(scene, o.build);

  OutputFile out(o.output);
  std::unique_ptr<OutputFile> offsets;
  if (query == GPURT_QUERY_ALL) offsets = std::make_unique<OutputFile>(o.offsets);
  Progress progress("tracing", o.device.quiet);
  constexpr uint64_t batch_size = uint64_t(1) << 22;  // 256 MiB with its hits
  std::vector<gpurt_ray> batch;
  uint64_t num_hits = 0;
  double seconds = 0;
  for (uint64_t first = 0; first < rays.count(); first += batch.size()) {
    batch.resize(std::min(batch_size, rays.count() - first));
    rays.read(batch.data(), batch.size());
    const auto start = std::chrono::steady_clock::now();
    num_hits += trace_batch(scene, query, batch, out, offsets.get(), num_hits);
    seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    progress.update(double(first + batch.size()) / double(rays.count()));
  }
  if (offsets) {
    offsets->write(&num_hits, sizeof num_hits);
    offsets->commit();
  }
  out.commit();
  if (o.device.quiet) return;
  const gpurt_scene_facts facts = facts_of(scene);
  fmt::print("{} rays, {} {}, {:.3f} s ({:.2f} million rays/s), {} built in {}\nwrote {}\n", rays.count(),
             num_hits, query == GPURT_QUERY_ANY ? "occluded" : "hits", seconds,
             seconds > 0 ? double(rays.count()) / seconds * 1e-6 : 0.0, name_of(facts.accel),
             format_seconds(facts.build_seconds), o.output);
}

}  // namespace

void add_trace_command(CLI::App &program)
{
  auto o = std::make_shared<TraceOptions>();
  CLI::App *command = program.add_subcommand("trace", "Trace a file of rays through a scene");
  command->footer(R"(
RAYS.bin is float32 [n][8] = ox oy oz tmin dx dy dz tmax, little-endian, no header. HITS.bin is
  closest   [n] of 32 bytes: float32 t, u, v; uint32 primitive, geometry, instance, 2 x padding;
            a miss has primitive 0xffffffff and t = tmax
  any       uint8 [n]: 1 where something is hit
  all       every crossing, sorted by t, ray after ray; --offsets is uint64 [n + 1], where each ray's begin

Example, with numpy:
  rays = np.zeros((n, 8), np.float32); rays[:, 4:7] = directions; rays[:, 7] = np.inf; rays.tofile("rays.bin")
  gpurt trace bunny.glb --rays rays.bin -o hits.bin
  hits = np.fromfile("hits.bin", [("tuv", "f4", 3), ("primitive", "u4"), ("geometry", "u4"), ("instance", "u4"), ("", "u4", 2)])
)");
  command->add_option("scene", o->scene, "glTF 2.0 file")->required()->type_name("SCENE");
  command->add_option("--rays", o->rays, "rays to trace")->required()->type_name("RAYS.bin");
  command->add_option("-o,--output", o->output, "hits")->required()->type_name("HITS.bin");
  command->add_option("--query", o->query, "closest, any or all")
      ->check(CLI::IsMember({"closest", "any", "all"}))
      ->type_name("QUERY")
      ->capture_default_str();
  command->add_option("--offsets", o->offsets, "where each ray's hits begin, for --query all")
      ->type_name("OFFSETS.bin");
  o->device.add_to(*command);
  o->build.add_to(*command);
  command->callback([o] { run(*o); });
}

}  // namespace cli
