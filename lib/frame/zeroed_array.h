// An array that begins as zeros, and keeps its memory when it begins again.
#pragma once

#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <new>
#include <type_traits>
#include <utility>

namespace gpurt {

template <class T>
class ZeroedArray {
  static_assert(std::is_trivially_copyable_v<T> && alignof(T) <= alignof(std::max_align_t));

 public:
  ZeroedArray() = default;
  ZeroedArray(const ZeroedArray &other)
  {
    reset(other.size_);
    if (size_ != 0) std::memcpy(data_, other.data_, size_ * sizeof(T));
  }
  ZeroedArray(ZeroedArray &&other) noexcept
      : data_(std::exchange(other.data_, nullptr)),
        size_(std::exchange(other.size_, 0)),
        capacity_(std::exchange(other.capacity_, 0))
  {}
  ZeroedArray &operator=(ZeroedArray other) noexcept
  {
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
    std::swap(capacity_, other.capacity_);
    return *this;
  }
  ~ZeroedArray() { std::free(data_); }

  /// `n` zeros. Throws std::bad_alloc.
  void reset(size_t n)
  {
    if (n <= capacity_) {
      if (n != 0) std::memset(static_cast<void *>(data_), 0, n * sizeof(T));
    } else {
      auto *data = static_cast<T *>(n <= ~size_t(0) / sizeof(T) ? std::malloc(n * sizeof(T)) : nullptr);
      if (data == nullptr) throw std::bad_alloc();
      // Touched here, by one thread: pages that many threads touch first at a time take twice as long in all.
      std::memset(static_cast<void *>(data), 0, n * sizeof(T));
      std::free(data_);
      data_ = data;
      capacity_ = n;
    }
    size_ = n;
  }

  T *data() { return data_; }
  const T *data() const { return data_; }
  size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  T &operator[](size_t i) { return data_[i]; }
  const T &operator[](size_t i) const { return data_[i]; }
  T *begin() { return data_; }
  T *end() { return data_ + size_; }
  const T *begin() const { return data_; }
  const T *end() const { return data_ + size_; }

 private:
  T *data_ = nullptr;
  size_t size_ = 0, capacity_ = 0;
};

}  // namespace gpurt
