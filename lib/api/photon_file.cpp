#include "api/photon_file.h"

#define XXH_INLINE_ALL
#include <xxhash.h>

#include <bit>
#include <cerrno>
#include <cstdio>
#include <cstring>

#include "image/atomic_file.h"

namespace gpurt::api {
namespace {

static_assert(std::endian::native == std::endian::little,
              "a big-endian machine needs byte swaps in this file");

constexpr char magic[8] = {'g', 'p', 'u', 'r', 't', 'p', 'h', 'o'};
constexpr uint32_t format_version = 2;

struct Header {
  char magic[8];
  uint32_t format_version;
  uint32_t num_levels;
  uint64_t num_points;
  float radius;
  uint32_t flags;  // 1: fluxes, 2: normals
  float flux_scale;
  uint32_t num_paths;
  uint64_t checksum;  // of the records, seeded with that of the fields before
};
static_assert(sizeof(Header) == 48, "padding would be written");

uint64_t checksum_of(const Header &header, const std::vector<Photon> &records)
{
  const uint64_t seed = XXH64(&header, offsetof(Header, checksum), 0);
  return XXH64(records.data(), records.size() * sizeof(Photon), seed);
}

}  // namespace

void write_photon_file(const std::string &path, const PhotonFile &file)
{
  Header header{};
  std::memcpy(header.magic, magic, sizeof magic);
  header.format_version = format_version;
  header.num_levels = file.num_levels;
  header.num_points = file.records.size();
  header.radius = file.radius;
  header.flux_scale = file.flux_scale;
  header.num_paths = file.num_paths;
  header.flags = (file.has_fluxes ? 1u : 0u) | (file.has_normals ? 2u : 0u);
  header.checksum = checksum_of(header, file.records);
  AtomicFile out(path);
  out.write(&header, sizeof header);
  out.write(file.records.data(), file.records.size() * sizeof(Photon));
  out.commit();
}

PhotonFile read_photon_file(const std::string &path, const std::shared_ptr<MemoryTracker> &memory)
{
  const auto fail_system = [&] {
    fail(GPURT_ERROR_IO, "{}: cannot be read: {}", path, std::strerror(errno));
  };
  const std::unique_ptr<std::FILE, int (*)(std::FILE *)> in(std::fopen(path.c_str(), "rb"), &std::fclose);
  if (!in || ::fseeko(in.get(), 0, SEEK_END) != 0) fail_system();
  const off_t end = ::ftello(in.get());
  if (end < 0 || ::fseeko(in.get(), 0, SEEK_SET) != 0) fail_system();
  const uint64_t size = uint64_t(end);
  Header header{};
  if (size < sizeof header || std::fread(&header, sizeof header, 1, in.get()) != 1 ||
      std::memcmp(header.magic, magic, sizeof magic) != 0) {
    fail(GPURT_ERROR_IO, "{}: not a photon map of gpurt", path);
  }
  if (header.format_version != format_version) {
    fail(GPURT_ERROR_IO, "{}: a photon map of format {}, and this version of gpurt reads format {}", path,
         header.format_version, format_version);
  }
  // Before memory is taken for them.
  if (header.num_points > max_photons || (size - sizeof header) != header.num_points * sizeof(Photon))
    fail(GPURT_ERROR_IO, "{}: damaged: {} bytes do not hold {} points", path, size, header.num_points);
  PhotonFile file;
  file.reservation = Reservation(memory, header.num_points * sizeof(Photon), "the points of a file");
  try {
    file.records.resize(header.num_points);
  } catch (const std::bad_alloc &) {
    fail(GPURT_ERROR_OUT_OF_MEMORY, "{}: its {} points need more memory than the system has", path,
         header.num_points);
  }
  if (!file.records.empty() &&
      std::fread(file.records.data(), sizeof(Photon), file.records.size(), in.get()) != file.records.size())
    fail_system();
  if (header.checksum != checksum_of(header, file.records))
    fail(GPURT_ERROR_IO, "{}: damaged: its checksum does not match", path);
  file.radius = header.radius;
  file.num_levels = header.num_levels;
  file.flux_scale = header.flux_scale;
  file.num_paths = header.num_paths;
  file.has_fluxes = (header.flags & 1) != 0;
  file.has_normals = (header.flags & 2) != 0;
  return file;
}

}  // namespace gpurt::api
