#include "api/descriptor.h"

#include <algorithm>

namespace gpurt::api {
namespace {

// No version of a struct will be larger: a size beyond it is garbage, and reading so far might leave the caller's memory.
constexpr uint32_t max_struct_size = 4096;

}  // namespace

uint32_t checked_struct_size(const void *caller, const StructInfo &info, const char *what)
{
  uint32_t size;
  std::memcpy(&size, caller, sizeof size);  // the pointer need not be aligned
  if (size < sizeof size || size > max_struct_size || size % 4 != 0) {
    fail_invalid(
        "{}: struct_size of {} is {}, which no version has; this library's is {}; initialise it with {}",
        what, info.name, size, info.size, info.init_macro);
  }
  // A size that ends in the middle of a pointer or count would leave half of it.
  if (size < info.size && std::find(info.wide_begin, info.wide_end, size - 4) != info.wide_end) {
    fail_invalid("{}: struct_size of {} is {}, which cuts a field in two; initialise it with {}", what,
                 info.name, size, info.init_macro);
  }
  return size;
}

void read_struct(void *ours, const void *caller, const StructInfo &info, const char *what)
{
  const uint32_t size = checked_struct_size(caller, info, what);
  const auto *bytes = static_cast<const unsigned char *>(caller);
  for (size_t i = info.size; i < size; ++i) {
    if (bytes[i] != 0) {
      fail_invalid(
          "{}: byte {} of {} is set, but this library knows only {} of its {} bytes; leave newer fields zero "
          "or "
          "use a newer library",
          what, i, info.name, info.size, size);
    }
  }
  std::memcpy(static_cast<unsigned char *>(ours) + 4, bytes + 4, std::min<size_t>(size, info.size) - 4);
}

void write_struct(void *caller, const void *ours, const StructInfo &info, const char *what)
{
  const uint32_t size = checked_struct_size(caller, info, what);
  auto *bytes = static_cast<unsigned char *>(caller);
  std::memcpy(bytes + 4, static_cast<const unsigned char *>(ours) + 4, std::min<size_t>(size, info.size) - 4);
  if (size > info.size) std::memset(bytes + info.size, 0, size - info.size);
}

}  // namespace gpurt::api
