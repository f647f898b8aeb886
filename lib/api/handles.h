// Handles: values that name objects in a table, never addresses. A handle of any origin can be looked up safely.
#pragma once

#include <memory>

#include "error.h"

namespace gpurt::api {

enum class HandleKind : uint8_t { Device = 1, Scene = 2, Frame = 3, Job = 4, Buffer = 5, PhotonMap = 6 };

/// "a scene", for messages.
const char *name_with_article(HandleKind kind);

struct Device;
struct Scene;
struct FrameObject;
struct JobObject;
struct Buffer;
struct PhotonMapObject;

/// What kind of object a handle type names.
template <class Handle>
struct HandleTraits;
template <>
struct HandleTraits<gpurt_device> {
  using Object = Device;
  static constexpr HandleKind kind = HandleKind::Device;
};
template <>
struct HandleTraits<gpurt_scene> {
  using Object = Scene;
  static constexpr HandleKind kind = HandleKind::Scene;
};
template <>
struct HandleTraits<gpurt_frame> {
  using Object = FrameObject;
  static constexpr HandleKind kind = HandleKind::Frame;
};
template <>
struct HandleTraits<gpurt_job> {
  using Object = JobObject;
  static constexpr HandleKind kind = HandleKind::Job;
};
template <>
struct HandleTraits<gpurt_photon_map> {
  using Object = PhotonMapObject;
  static constexpr HandleKind kind = HandleKind::PhotonMap;
};
template <>
struct HandleTraits<gpurt_buffer> {
  using Object = Buffer;
  static constexpr HandleKind kind = HandleKind::Buffer;
};

/// The table, untyped. All functions are safe to call from any thread and throw INVALID_ARGUMENT for a value that is
/// no live handle of the kind; `what` names the argument in the message.
namespace table {
/// A new handle with one reference.
uintptr_t insert(HandleKind kind, std::shared_ptr<void> object);
std::shared_ptr<void> find(uintptr_t value, HandleKind kind, const char *what);
void retain(uintptr_t value, HandleKind kind, const char *what);
/// Takes a reference away. Returns the object if that was the last one: the handle is stale from then on.
std::shared_ptr<void> release(uintptr_t value, HandleKind kind, const char *what);
}  // namespace table

/// A new handle of an object.
template <class Handle>
Handle publish(std::shared_ptr<typename HandleTraits<Handle>::Object> object)
{
  return reinterpret_cast<Handle>(table::insert(HandleTraits<Handle>::kind, std::move(object)));
}

/// The object of a handle, alive for as long as the caller keeps the pointer.
template <class Handle>
std::shared_ptr<typename HandleTraits<Handle>::Object> get(Handle handle, const char *what)
{
  return std::static_pointer_cast<typename HandleTraits<Handle>::Object>(
      table::find(reinterpret_cast<uintptr_t>(handle), HandleTraits<Handle>::kind, what));
}

template <class Handle>
void retain(Handle handle, const char *what)
{
  table::retain(reinterpret_cast<uintptr_t>(handle), HandleTraits<Handle>::kind, what);
}

/// The object if the last reference went away, else null.
template <class Handle>
std::shared_ptr<typename HandleTraits<Handle>::Object> release(Handle handle, const char *what)
{
  return std::static_pointer_cast<typename HandleTraits<Handle>::Object>(
      table::release(reinterpret_cast<uintptr_t>(handle), HandleTraits<Handle>::kind, what));
}

}  // namespace gpurt::api
