// Files that appear whole or not at all.
#pragma once

#include <cstdint>
#include <cstdio>
#include <string>

namespace gpurt {

/// A new file under a temporary name in the folder of `path`; commit() renames it to `path`. Without commit() it is
/// removed and what was at `path` stays. Failures throw IO and name the path and the system's reason.
class AtomicFile {
 public:
  explicit AtomicFile(std::string path);
  ~AtomicFile();
  AtomicFile(const AtomicFile &) = delete;
  AtomicFile &operator=(const AtomicFile &) = delete;

  void write(const void *data, uint64_t size_bytes);
  uint64_t tell() const;
  void seek(uint64_t position);
  void commit();
  const std::string &path() const { return path_; }

 private:
  [[noreturn]] void fail_io(const char *what) const;

  std::string path_, temporary_;
  std::FILE *file_ = nullptr;
};

}  // namespace gpurt
