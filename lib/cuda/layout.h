// Arrays that share a buffer in device memory.
#pragma once

#include <cstddef>
#include <cstdint>

namespace gpurt::cuda {

/// Lays arrays out one behind the other, each where 16-byte loads and full memory transactions begin.
class Layout {
 public:
  explicit Layout(std::byte *base) : base_(base) {}
  template <class T>
  T *take(uint64_t count)
  {
    T *p = base_ == nullptr ? nullptr : reinterpret_cast<T *>(base_ + bytes_);
    bytes_ += (count * sizeof(T) + 255) / 256 * 256;
    return p;
  }
  uint64_t bytes() const { return bytes_; }

 private:
  std::byte *base_;
  uint64_t bytes_ = 0;
};

}  // namespace gpurt::cuda
