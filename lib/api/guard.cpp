#include "api/guard.h"

#include <algorithm>
#include <cstring>
#include <new>
#include <stdexcept>
#include <string_view>

namespace gpurt::api {
namespace {

// Fixed memory, so that an allocation failure can be reported and a thread's end destroys nothing. Room for a path and a
// sentence.
constexpr size_t capacity = 6144;
thread_local char text[capacity];

void store(std::string_view message) noexcept
{
  constexpr std::string_view more = " ...";
  size_t size = std::min(message.size(), capacity - 1);
  std::memcpy(text, message.data(), size);
  text[size] = 0;
  if (size < message.size()) std::memcpy(text + size - more.size(), more.data(), more.size());
}

// Joins without allocating.
void store_internal(const char *function, const char *what) noexcept
{
  store("internal error in ");
  std::strncat(text, function, capacity - std::strlen(text) - 1);
  std::strncat(text, ": ", capacity - std::strlen(text) - 1);
  std::strncat(text, what, capacity - std::strlen(text) - 1);
}

}  // namespace

const char *last_error() noexcept { return text; }

gpurt_result report_exception(const char *function) noexcept
{
  try {
    throw;
  } catch (const Error &e) {
    store(e.what());
    return e.result();
  } catch (const std::bad_alloc &) {
    store("out of memory: the system refused an allocation; make the scene, frame or batch smaller");
    return GPURT_ERROR_OUT_OF_MEMORY;
  } catch (const std::length_error &) {
    // What std::vector throws for sizes that no memory could hold.
    store(
        "out of memory: an array would be larger than memory can be; make the scene, frame or batch smaller");
    return GPURT_ERROR_OUT_OF_MEMORY;
  } catch (const std::exception &e) {
    store_internal(function, e.what());
    return GPURT_ERROR_INTERNAL;
  } catch (...) {
    store_internal(function, "an exception of unknown type");
    return GPURT_ERROR_INTERNAL;
  }
}

}  // namespace gpurt::api
