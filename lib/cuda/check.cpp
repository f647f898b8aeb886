#include "cuda/check.h"

#include <atomic>
#include <map>
#include <mutex>

#include "error.h"

namespace gpurt::cuda {
namespace {

// Of devices that are lost, by ordinal.
struct Losses {
  std::atomic<bool> any{false};
  std::mutex mutex;
  std::map<int, std::string> texts;
};

Losses &losses()
{
  static auto *const all = new Losses;  // lives as long as the process: destructors of others may ask
  return *all;
}

// Errors after which, as CUDA documents them, the process has to end before the device works for it again.
bool ends_all_work(cudaError_t status)
{
  switch (status) {
    case cudaErrorECCUncorrectable:
    case cudaErrorNvlinkUncorrectable:
    case cudaErrorIllegalAddress:
    case cudaErrorLaunchTimeout:
    case cudaErrorAssert:
    case cudaErrorHardwareStackError:
    case cudaErrorIllegalInstruction:
    case cudaErrorMisalignedAddress:
    case cudaErrorInvalidAddressSpace:
    case cudaErrorInvalidPc:
    case cudaErrorLaunchFailure:
    case cudaErrorMpsClientTerminated:
      return true;
    default:
      return false;
  }
}

}  // namespace

void check(cudaError_t status, const char *call)
{
  if (status == cudaSuccess) return;
  (void)cudaGetLastError();
  if (status == cudaErrorMemoryAllocation) {
    fail(GPURT_ERROR_OUT_OF_MEMORY,
         "{}: the CUDA device has not enough free memory; make the scene or batch smaller, "
         "or free memory that other programs hold on the device",
         call);
  }
  const std::string text =
      fmt::format("{} failed: {} ({})", call, cudaGetErrorName(status), cudaGetErrorString(status));
  int ordinal = 0;
  if (ends_all_work(status) && cudaGetDevice(&ordinal) == cudaSuccess) {
    Losses &all = losses();
    {
      const std::lock_guard lock(all.mutex);
      all.texts.try_emplace(
          ordinal,
          fmt::format("{}. CUDA device {} is lost to this process, with all that it held: check the device "
                      "pointers and sizes that it was given, by other libraries too, and start the process "
                      "again; the CPU device and other CUDA devices go on",
                      text, ordinal));
      all.any = true;
    }
    check_is_not_lost(ordinal);
  }
  fail(GPURT_ERROR_DEVICE, "{}", text);
}

void check_is_not_lost(int ordinal)
{
  Losses &all = losses();
  if (!all.any) return;
  const std::lock_guard lock(all.mutex);
  const auto found = all.texts.find(ordinal);
  if (found != all.texts.end()) fail(GPURT_ERROR_DEVICE, "{}", found->second);
}

}  // namespace gpurt::cuda
