// An array of plain values that is counted against the device's memory limit and not initialised.
#pragma once

#include <memory>
#include <type_traits>

#include "memory.h"

namespace gpurt {

template <class T>
class TrackedArray {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  TrackedArray() = default;
  /// Throws OUT_OF_MEMORY naming `what`.
  TrackedArray(const std::shared_ptr<MemoryTracker> &tracker, uint64_t size, const char *what)
      : reservation_(tracker, size * sizeof(T), what), size_(size)
  {
    if (size != 0) data_.reset(static_cast<T *>(::operator new(size * sizeof(T), std::align_val_t(64))));
  }

  uint64_t size() const { return size_; }
  uint64_t bytes() const { return size_ * sizeof(T); }
  T *data() { return data_.get(); }
  const T *data() const { return data_.get(); }
  T &operator[](uint64_t i) { return data_.get()[i]; }
  const T &operator[](uint64_t i) const { return data_.get()[i]; }
  void free()
  {
    data_.reset();
    reservation_ = {};
    size_ = 0;
  }

 private:
  struct Delete {
    void operator()(T *p) const { ::operator delete(static_cast<void *>(p), std::align_val_t(64)); }
  };
  Reservation reservation_;
  std::unique_ptr<T[], Delete> data_;
  uint64_t size_ = 0;
};

}  // namespace gpurt
