#include "accel/kd_cache.h"

#include <unistd.h>

#include <bit>
#include <cerrno>
#include <cstdio>
#include <cstring>

namespace gpurt {
namespace {

static_assert(std::endian::native == std::endian::little,
              "cache files are little endian; add byte swaps for other machines");

constexpr char magic[8] = {'g', 'p', 'u', 'r', 't', 'k', 'd', 1};
// Counts up whenever the builder makes other trees of the same input.
constexpr uint64_t builder_version = 2;

struct FileHeader {
  char magic[8];
  uint64_t key;
  uint64_t num_trees;
};

struct TreeHeader {
  uint64_t num_primitives, num_nodes, num_references;
  float bounds[6];
  double sah_cost;
};

// Mixes words so that any changed, missing or moved one shows. Finaliser of MurmurHash3 (public domain).
class Checksum {
 public:
  void add(const void *data, size_t bytes)
  {
    const auto *p = static_cast<const unsigned char *>(data);
    while (bytes != 0) {
      uint64_t word = 0;
      const size_t n = bytes < 8 ? bytes : 8;
      std::memcpy(&word, p, n);
      mix(word);
      p += n;
      bytes -= n;
    }
  }
  void mix(uint64_t word)
  {
    uint64_t h = (value_ ^ word) * 0xff51afd7ed558ccdull;
    h ^= h >> 33;
    value_ = h * 0xc4ceb9fe1a85ec53ull + 1;
  }
  uint64_t value() const { return value_; }

 private:
  uint64_t value_ = 0x9e3779b97f4a7c15ull;
};

class File {
 public:
  File(const char *path, const char *mode) : file_(std::fopen(path, mode)) {}
  ~File()
  {
    if (file_) std::fclose(file_);
  }
  File(const File &) = delete;
  File &operator=(const File &) = delete;
  explicit operator bool() const { return file_ != nullptr; }
  bool read(void *data, size_t bytes) { return bytes == 0 || std::fread(data, 1, bytes, file_) == bytes; }
  bool write(const void *data, size_t bytes)
  {
    return bytes == 0 || std::fwrite(data, 1, bytes, file_) == bytes;
  }
  // What is left to read: counts in a damaged file must not make us allocate more.
  uint64_t bytes_left()
  {
    const long here = std::ftell(file_);
    std::fseek(file_, 0, SEEK_END);
    const long end = std::ftell(file_);
    std::fseek(file_, here, SEEK_SET);
    return uint64_t(end - here);
  }
  bool close()
  {
    const bool is_good = std::fflush(file_) == 0 && fsync(fileno(file_)) == 0;
    const bool is_closed = std::fclose(std::exchange(file_, nullptr)) == 0;
    return is_good && is_closed;
  }

 private:
  std::FILE *file_;
};

}  // namespace

uint64_t kd_cache_key(uint64_t scene_hash, const BuildOptions &options)
{
  Checksum key;
  key.mix(builder_version);
  key.mix(scene_hash);
  key.mix(options.max_depth);
  key.mix(float_bits(options.traversal_cost));
  key.mix(float_bits(options.empty_bonus));
  return key.value();
}

std::optional<std::vector<CachedTree>> read_kd_cache(const std::string &path, uint64_t key,
                                                     std::string &reason)
{
  File file(path.c_str(), "rb");
  if (!file) {
    reason = errno == ENOENT ? "it does not exist" : std::strerror(errno);
    return std::nullopt;
  }
  const auto damaged = [&](const char *what) {
    reason = what;
    return std::nullopt;
  };
  Checksum sum;
  FileHeader header;
  if (!file.read(&header, sizeof header) || std::memcmp(header.magic, magic, sizeof magic) != 0) {
    return damaged("it is no kd-tree file of this version");
  }
  if (header.key != key) return damaged("it is of another scene or other build options");
  sum.add(&header, sizeof header);
  if (header.num_trees > file.bytes_left() / sizeof(TreeHeader)) return damaged("it is cut short");
  std::vector<CachedTree> trees(header.num_trees);
  for (CachedTree &t : trees) {
    TreeHeader h;
    if (!file.read(&h, sizeof h)) return damaged("it is cut short");
    sum.add(&h, sizeof h);
    const uint64_t left = file.bytes_left();
    if (h.num_nodes > left / sizeof(KdNode) ||
        h.num_references > (left - h.num_nodes * sizeof(KdNode)) / sizeof(uint32_t)) {
      return damaged("it is cut short");
    }
    t.tree.nodes.resize(h.num_nodes);
    t.tree.references.resize(h.num_references);
    t.tree.num_triangles = h.num_primitives;
    t.tree.bounds = {{h.bounds[0], h.bounds[1], h.bounds[2]}, {h.bounds[3], h.bounds[4], h.bounds[5]}};
    t.sah_cost = h.sah_cost;
    if (!file.read(t.tree.nodes.data(), h.num_nodes * sizeof(KdNode)) ||
        !file.read(t.tree.references.data(), h.num_references * sizeof(uint32_t))) {
      return damaged("it cannot be read to its end");
    }
    sum.add(t.tree.nodes.data(), h.num_nodes * sizeof(KdNode));
    sum.add(t.tree.references.data(), h.num_references * sizeof(uint32_t));
  }
  uint64_t expected;
  if (!file.read(&expected, sizeof expected)) return damaged("it is cut short");
  if (expected != sum.value() || file.bytes_left() != 0) return damaged("its checksum is wrong");
  return trees;
}

void write_kd_cache(const std::string &path, uint64_t key, const std::vector<CachedTree> &trees)
{
  const std::string temporary = fmt::format("{}.{}.tmp", path, getpid());
  const auto failed = [&] {
    const int error = errno;
    std::remove(temporary.c_str());
    fail(GPURT_ERROR_IO, "cannot write the kd-tree cache {}: {}", path, std::strerror(error));
  };
  {
    File file(temporary.c_str(), "wb");
    if (!file) failed();
    Checksum sum;
    bool is_good = true;
    const auto put = [&](const void *data, size_t bytes) {
      is_good = is_good && file.write(data, bytes);
      sum.add(data, bytes);
    };
    FileHeader header{};
    std::memcpy(header.magic, magic, sizeof magic);
    header.key = key;
    header.num_trees = trees.size();
    put(&header, sizeof header);
    for (const CachedTree &t : trees) {
      const Box &b = t.tree.bounds;
      const TreeHeader h = {t.tree.num_triangles,
                            t.tree.nodes.size(),
                            t.tree.references.size(),
                            {b.lo.x, b.lo.y, b.lo.z, b.hi.x, b.hi.y, b.hi.z},
                            t.sah_cost};
      put(&h, sizeof h);
      put(t.tree.nodes.data(), t.tree.nodes.size() * sizeof(KdNode));
      put(t.tree.references.data(), t.tree.references.size() * sizeof(uint32_t));
    }
    const uint64_t value = sum.value();
    is_good = is_good && file.write(&value, sizeof value);
    if (!is_good || !file.close()) failed();
  }
  if (std::rename(temporary.c_str(), path.c_str()) != 0) failed();
}

}  // namespace gpurt
