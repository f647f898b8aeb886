#include "dlpack.h"

#include <pybind11/stl.h>

#include <cstring>
#include <memory>

#include "call.h"

namespace gpurt_python {

namespace {

constexpr const char *name = "dltensor", *used_name = "used_dltensor";
constexpr const char *versioned_name = "dltensor_versioned", *used_versioned_name = "used_dltensor_versioned";

[[noreturn]] void raise_buffer_error(const std::string &message)
{
  PyErr_SetString(PyExc_BufferError, message.c_str());
  throw py::error_already_set();
}

// What a lent tensor keeps: the owner of its memory, and its shape.
struct Lent {
  PyObject *owner;
  std::vector<int64_t> shape, strides;
};

// The other library may let go on any thread of its own, with or without Python's lock.
template <class M>
void end_loan(M *managed)
{
  const std::unique_ptr<Lent> lent(static_cast<Lent *>(managed->context));
  drop_object(lent->owner);
  delete managed;
}

// A capsule that nobody took: the loan ends with it. The name tells, since whoever takes it changes the name.
template <class M>
void free_capsule(PyObject *capsule, const char *unused_name)
{
  if (!PyCapsule_IsValid(capsule, unused_name)) return;
  auto *managed = static_cast<M *>(PyCapsule_GetPointer(capsule, unused_name));
  managed->deleter(managed);
}

template <class M>
py::capsule make_capsule(std::unique_ptr<M> managed, const char *capsule_name,
                         PyCapsule_Destructor destructor)
{
  PyObject *capsule = PyCapsule_New(managed.get(), capsule_name, destructor);
  if (!capsule) {
    M *const unused = managed.release();
    unused->deleter(unused);
    throw py::error_already_set();
  }
  managed.release();
  return py::reinterpret_steal<py::capsule>(capsule);
}

py::tuple to_tuple(const int64_t *values, int32_t count)
{
  py::tuple tuple(static_cast<std::size_t>(count));
  for (int32_t i = 0; i < count; ++i) tuple[static_cast<std::size_t>(i)] = values[i];
  return tuple;
}

}  // namespace

BorrowedTensor::BorrowedTensor(const py::capsule &capsule)
{
  PyObject *object = capsule.ptr();
  if (PyCapsule_IsValid(object, versioned_name)) {
    auto *managed = static_cast<dlpack::ManagedVersioned *>(PyCapsule_GetPointer(object, versioned_name));
    if (managed->major != dlpack::major_version) {
      raise_buffer_error("DLPack of version " + std::to_string(managed->major) +
                         "; versions 0 and 1 are known");
    }
    if (PyCapsule_SetName(object, used_versioned_name) != 0) throw py::error_already_set();
    versioned_ = managed;
    tensor_ = &managed->tensor;
    read_only_ = (managed->flags & dlpack::flag_read_only) != 0;
  } else if (PyCapsule_IsValid(object, name)) {
    auto *managed = static_cast<dlpack::Managed *>(PyCapsule_GetPointer(object, name));
    if (PyCapsule_SetName(object, used_name) != 0) throw py::error_already_set();
    managed_ = managed;
    tensor_ = &managed->tensor;
  } else {
    raise_buffer_error(
        "__dlpack__ returned a capsule that holds no tensor, or whose tensor was taken before");
  }
}

BorrowedTensor::~BorrowedTensor()
{
  if (managed_ && managed_->deleter) managed_->deleter(managed_);
  if (versioned_ && versioned_->deleter) versioned_->deleter(versioned_);
}

std::uintptr_t BorrowedTensor::data() const
{
  return reinterpret_cast<std::uintptr_t>(tensor_->data) + static_cast<std::uintptr_t>(tensor_->byte_offset);
}
py::tuple BorrowedTensor::device() const { return py::make_tuple(tensor_->device.type, tensor_->device.id); }
py::tuple BorrowedTensor::dtype() const
{
  return py::make_tuple(tensor_->dtype.code, tensor_->dtype.bits, tensor_->dtype.lanes);
}
py::tuple BorrowedTensor::shape() const { return to_tuple(tensor_->shape, tensor_->ndim); }
py::object BorrowedTensor::strides() const
{
  if (!tensor_->strides) return py::none();
  return to_tuple(tensor_->strides, tensor_->ndim);
}

py::capsule lend_tensor(const py::object &owner, std::uintptr_t data, const std::vector<int64_t> &shape,
                        uint8_t dtype_code, uint8_t dtype_bits, int32_t device_type, int32_t device_id,
                        bool versioned)
{
  auto lent = std::make_unique<Lent>(Lent{owner.ptr(), shape, std::vector<int64_t>(shape.size(), 1)});
  for (std::size_t i = shape.size(); i-- > 1;) lent->strides[i - 1] = lent->strides[i] * shape[i];
  const dlpack::Tensor tensor = {reinterpret_cast<void *>(data),
                                 {device_type, device_id},
                                 static_cast<int32_t>(shape.size()),
                                 {dtype_code, dtype_bits, 1},
                                 lent->shape.data(),
                                 lent->strides.data(),
                                 0};
  if (versioned) {
    auto managed = std::make_unique<dlpack::ManagedVersioned>();
    *managed = {dlpack::major_version,
                dlpack::minor_version,
                lent.get(),
                end_loan<dlpack::ManagedVersioned>,
                0,
                tensor};
    py::object(owner).release();  // the loan holds it
    lent.release();
    return make_capsule(std::move(managed), versioned_name, [](PyObject *capsule) {
      free_capsule<dlpack::ManagedVersioned>(capsule, versioned_name);
    });
  }
  auto managed = std::make_unique<dlpack::Managed>();
  *managed = {tensor, lent.get(), end_loan<dlpack::Managed>};
  py::object(owner).release();
  lent.release();
  return make_capsule(std::move(managed), name,
                      [](PyObject *capsule) { free_capsule<dlpack::Managed>(capsule, name); });
}

void bind_dlpack(py::module_ &module)
{
  py::class_<BorrowedTensor>(module, "BorrowedTensor")
      .def(py::init<const py::capsule &>(), py::arg("capsule"))
      .def("data", &BorrowedTensor::data)
      .def("device", &BorrowedTensor::device)
      .def("dtype", &BorrowedTensor::dtype)
      .def("shape", &BorrowedTensor::shape)
      .def("strides", &BorrowedTensor::strides)
      .def("read_only", &BorrowedTensor::read_only);
  module.def("lend_tensor", lend_tensor, py::arg("owner"), py::arg("data"), py::arg("shape"),
             py::arg("dtype_code"), py::arg("dtype_bits"), py::arg("device_type"), py::arg("device_id"),
             py::arg("versioned"));
}

}  // namespace gpurt_python
