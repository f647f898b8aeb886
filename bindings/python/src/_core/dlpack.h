// DLPack: how array libraries hand memory to each other. The structures are those of its specification, versions 0 and 1.
#pragma once

#include <pybind11/pybind11.h>

#include <cstdint>
#include <string>
#include <vector>

namespace gpurt_python {

namespace py = pybind11;

namespace dlpack {

constexpr uint32_t major_version = 1, minor_version = 0;
constexpr uint64_t flag_read_only = 1;

enum DeviceType : int32_t { cpu = 1, cuda = 2, cuda_host = 3, cuda_managed = 13 };

struct Device {
  int32_t type;
  int32_t id;
};
struct DataType {
  uint8_t code;
  uint8_t bits;
  uint16_t lanes;
};
struct Tensor {
  void *data;
  Device device;
  int32_t ndim;
  DataType dtype;
  int64_t *shape;
  int64_t *strides;  // in elements; null: packed, last axis fastest
  uint64_t byte_offset;
};
struct Managed {
  Tensor tensor;
  void *context;
  void (*deleter)(Managed *);
};
struct ManagedVersioned {
  uint32_t major, minor;
  void *context;
  void (*deleter)(ManagedVersioned *);
  uint64_t flags;
  Tensor tensor;
};

}  // namespace dlpack

/// An array of another library, taken out of the capsule that its __dlpack__ returned. The memory is held while this lives.
class BorrowedTensor {
 public:
  /// Raises BufferError for a capsule that is used up or of a version that is not known.
  explicit BorrowedTensor(const py::capsule &capsule);
  ~BorrowedTensor();
  BorrowedTensor(const BorrowedTensor &) = delete;
  BorrowedTensor &operator=(const BorrowedTensor &) = delete;

  std::uintptr_t data() const;
  py::tuple device() const;
  py::tuple dtype() const;
  py::tuple shape() const;
  py::object strides() const;
  bool read_only() const { return read_only_; }

 private:
  const dlpack::Tensor *tensor_ = nullptr;
  bool read_only_ = false;
  dlpack::Managed *managed_ = nullptr;
  dlpack::ManagedVersioned *versioned_ = nullptr;
};

/// A capsule of packed memory for another library, which keeps `owner` alive until it is done.
py::capsule lend_tensor(const py::object &owner, std::uintptr_t data, const std::vector<int64_t> &shape,
                        uint8_t dtype_code, uint8_t dtype_bits, int32_t device_type, int32_t device_id,
                        bool versioned);

void bind_dlpack(py::module_ &module);

}  // namespace gpurt_python
