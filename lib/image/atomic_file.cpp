#include "image/atomic_file.h"

#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <utility>

#include "error.h"

namespace gpurt {

namespace {

std::string temporary_name(const std::string &path)
{
  static std::atomic<uint64_t> counter{0};
  return fmt::format("{}.tmp-{}-{}", path, ::getpid(), counter++);
}

}  // namespace

AtomicFile::AtomicFile(std::string path) : path_(std::move(path)), temporary_(temporary_name(path_))
{
  file_ = std::fopen(temporary_.c_str(), "wbx");
  if (!file_) fail_io("cannot be created");
}

AtomicFile::~AtomicFile()
{
  if (!file_) return;
  std::fclose(file_);
  std::remove(temporary_.c_str());
}

void AtomicFile::fail_io(const char *what) const
{
  const int error = errno;
  fail(GPURT_ERROR_IO, "{}: {}: {}", path_, what, std::strerror(error));
}

void AtomicFile::write(const void *data, uint64_t size_bytes)
{
  if (size_bytes != 0 && std::fwrite(data, 1, size_bytes, file_) != size_bytes) fail_io("cannot be written");
}

uint64_t AtomicFile::tell() const
{
  const off_t position = ::ftello(file_);
  if (position < 0) fail_io("has no position");
  return uint64_t(position);
}

void AtomicFile::seek(uint64_t position)
{
  if (::fseeko(file_, off_t(position), SEEK_SET) != 0) fail_io("cannot be positioned");
}

void AtomicFile::commit()
{
  // Closing is where a full disk may show, so it is part of writing.
  std::FILE *file = std::exchange(file_, nullptr);
  const bool flushed = std::fflush(file) == 0 && !std::ferror(file);
  const int flush_error = errno;
  const bool closed = std::fclose(file) == 0;
  if (flushed && closed && std::rename(temporary_.c_str(), path_.c_str()) == 0) return;
  const int error = flushed ? errno : flush_error;
  std::remove(temporary_.c_str());
  errno = error;
  fail_io("cannot be written");
}

}  // namespace gpurt
