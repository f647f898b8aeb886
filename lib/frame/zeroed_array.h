// An array that begins as zeros, and keeps its memory when it begins again.
#pragma once

#include <cstddef>
#include <cstring>
#include <new>
#include <type_traits>
#include <utility>

#include "frame/film_memory.h"

namespace gpurt {

template <class T>
class ZeroedArray {
  static_assert(std::is_trivially_copyable_v<T> && alignof(T) <= alignof(std::max_align_t));

 public:
  ZeroedArray() = default;
  ZeroedArray(const ZeroedArray &other)
  {
    reset(other.size_);
    if (size_ != 0) std::memcpy(static_cast<void *>(data_), other.data_, size_ * sizeof(T));
  }
  ZeroedArray(ZeroedArray &&other) noexcept
      : data_(std::exchange(other.data_, nullptr)),
        size_(std::exchange(other.size_, 0)),
        capacity_bytes_(std::exchange(other.capacity_bytes_, 0))
  {}
  ZeroedArray &operator=(ZeroedArray other) noexcept
  {
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
    std::swap(capacity_bytes_, other.capacity_bytes_);
    return *this;
  }
  ~ZeroedArray()
  {
    if (data_ != nullptr) give_memory_back(data_, capacity_bytes_);
  }

  /// `n` zeros. Throws std::bad_alloc.
  void reset(size_t n)
  {
    reserve(n);
    clear();
  }
  /// `n` values that are yet to be written. Throws std::bad_alloc.
  void reserve(size_t n)
  {
    if (n > ~size_t(0) / sizeof(T)) throw std::bad_alloc();
    const size_t bytes = n * sizeof(T);
    if (bytes > capacity_bytes_) {
      size_t capacity;
      void *data = take_memory(bytes, capacity);
      if (data_ != nullptr) give_memory_back(data_, capacity_bytes_);
      data_ = static_cast<T *>(data);
      capacity_bytes_ = capacity;
    }
    size_ = n;
  }
  void clear()
  {
    if (size_ != 0) clear_memory(data_, size_ * sizeof(T));
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
  size_t size_ = 0, capacity_bytes_ = 0;
};

}  // namespace gpurt
