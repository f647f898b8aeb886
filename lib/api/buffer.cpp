// gpurt_buffer_*: memory of gpurt, or of the caller with a release function.
#include <cstdlib>

#include "api/descriptor.h"
#include "api/guard.h"
#include "api/objects.h"

namespace gpurt::api {

Buffer::~Buffer()
{
  if (!release) return;
  try {
    release(release_user, data);
  } catch (...) {
    // An exception of the caller's function has nobody to go to.
  }
}

namespace {

constexpr size_t buffer_alignment = 64;

std::shared_ptr<void> allocate_host(uint64_t bytes)
{
  const uint64_t rounded = (bytes + buffer_alignment - 1) / buffer_alignment * buffer_alignment;
  void *memory = rounded >= bytes ? std::aligned_alloc(buffer_alignment, rounded) : nullptr;
  if (!memory) fail(GPURT_ERROR_OUT_OF_MEMORY, "the system has no {} bytes for a buffer", bytes);
  std::memset(memory, 0, rounded);
  return {memory, std::free};
}

std::shared_ptr<Buffer> create_buffer(std::shared_ptr<Device> device, const gpurt_buffer_desc &d)
{
  check_enum(d.storage, GPURT_STORAGE_DEVICE + 1, "storage", "gpurt_storage");
  if (d.size_bytes == 0) fail_invalid("size_bytes is 0; a buffer has at least one byte");
  if (d.data && d.size_bytes > UINTPTR_MAX - reinterpret_cast<uintptr_t>(d.data)) {
    fail_invalid("size_bytes is {}: the buffer would reach past the end of memory", d.size_bytes);
  }
  if (!d.data && d.release) {
    fail_invalid("release is given, but data is NULL: gpurt allocates and frees the memory itself");
  }
  auto buffer = std::make_shared<Buffer>();
  buffer->device = std::move(device);
  buffer->storage = d.storage;
  buffer->size_bytes = d.size_bytes;
  buffer->data = d.data;
  if (!d.data && buffer->is_host()) {
    buffer->reservation = Reservation(buffer->device->memory(), d.size_bytes, "a buffer");
    buffer->owned = allocate_host(d.size_bytes);
    buffer->data = buffer->owned.get();
  } else if (!d.data) {
    buffer->owned = buffer->device->backend->allocate(d.size_bytes);
    buffer->data = buffer->owned.get();
  }
  return buffer;
}

// Part of a buffer, checked.
std::byte *part_of(const Buffer &buffer, uint64_t offset_bytes, const void *host, uint64_t size_bytes)
{
  if (offset_bytes > buffer.size_bytes || size_bytes > buffer.size_bytes - offset_bytes) {
    fail_invalid("{} bytes from byte {} on leave the buffer, which has {}", size_bytes, offset_bytes,
                 buffer.size_bytes);
  }
  if (size_bytes != 0) require(host, "data");
  return static_cast<std::byte *>(buffer.data) + offset_bytes;
}

}  // namespace
}  // namespace gpurt::api

using namespace gpurt;
using namespace gpurt::api;

gpurt_result gpurt_buffer_create(gpurt_device device, const gpurt_buffer_desc *desc, gpurt_buffer *out_buffer)
{
  return guard([&] {
    const auto parent = get(device, "device");
    require(out_buffer, "out_buffer");
    const gpurt_buffer_desc d = read_descriptor(desc);
    const auto buffer = create_buffer(parent, d);
    const auto handle = publish<gpurt_buffer>(buffer);
    // Only now is the caller's memory taken over: where the call fails, the release function is not called.
    buffer->release = d.release;
    buffer->release_user = d.release_user;
    *out_buffer = handle;
  });
}

gpurt_result gpurt_buffer_retain(gpurt_buffer buffer)
{
  return guard([&] { retain(buffer, "buffer"); });
}

gpurt_result gpurt_buffer_release(gpurt_buffer buffer)
{
  return guard([&] { release(buffer, "buffer"); });
}

gpurt_result gpurt_buffer_write(gpurt_buffer buffer, uint64_t offset_bytes, const void *data,
                                uint64_t size_bytes)
{
  return guard([&] {
    const auto object = get(buffer, "buffer");
    std::byte *const part = part_of(*object, offset_bytes, data, size_bytes);
    if (size_bytes == 0) return;
    if (object->is_host()) std::memcpy(part, data, size_bytes);
    else object->device->backend->copy_to_device(part, data, size_bytes);
  });
}

gpurt_result gpurt_buffer_read(gpurt_buffer buffer, uint64_t offset_bytes, void *data, uint64_t size_bytes)
{
  return guard([&] {
    const auto object = get(buffer, "buffer");
    const std::byte *const part = part_of(*object, offset_bytes, data, size_bytes);
    if (size_bytes == 0) return;
    if (object->is_host()) std::memcpy(data, part, size_bytes);
    else object->device->backend->copy_to_host(data, part, size_bytes);
  });
}

gpurt_result gpurt_buffer_get_data(gpurt_buffer buffer, void **out_data, uint64_t *out_size_bytes)
{
  return guard([&] {
    const auto object = get(buffer, "buffer");
    require(out_data, "out_data");
    require(out_size_bytes, "out_size_bytes");
    *out_data = object->data;
    *out_size_bytes = object->size_bytes;
  });
}
