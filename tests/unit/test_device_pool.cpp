// Device memory with a limit: what the pool holds of the device stays below it, whatever is allocated and freed.
#include <gtest/gtest.h>

#include <optional>
#include <vector>

#include "cuda/device_memory.h"
#include "device_mesh.h"
#include "error.h"
#include "memory.h"
#include "random_values.h"

namespace gpurt {
namespace {

using cuda::DeviceBuffer;
using cuda::DeviceMemory;
constexpr uint64_t mib = uint64_t(1) << 20;

class CudaPool : public testing::Test {
 protected:
  void SetUp() override
  {
    if (!test::has_cuda()) GTEST_SKIP() << "no CUDA device";
    ASSERT_EQ(cudaSetDevice(0), cudaSuccess);
  }
};

using Buffer = DeviceBuffer<std::byte>;

// Null where there is no room.
std::optional<Buffer> try_buffer(const std::shared_ptr<DeviceMemory> &memory, uint64_t bytes)
{
  try {
    return Buffer(memory, bytes, "a buffer of a test");
  } catch (const Error &error) {
    EXPECT_EQ(error.result(), GPURT_ERROR_OUT_OF_MEMORY);
    EXPECT_NE(std::string(error.what()).find("memory limit"), std::string::npos) << error.what();
    return std::nullopt;
  }
}

TEST_F(CudaPool, HoldsNoMoreThanTheLimit)
{
  constexpr uint64_t limit = 165 * mib;
  const auto memory = std::make_shared<DeviceMemory>(0, limit);
  Random random(3);
  std::vector<Buffer> buffers;
  uint64_t most_used = 0, most_held = 0, num_refused = 0;
  for (int i = 0; i < 3000; ++i) {
    const bool frees = !buffers.empty() && random.below(5) < 2;
    if (frees) {
      std::swap(buffers[random.below(uint32_t(buffers.size()))], buffers.back());
      buffers.pop_back();
    } else {
      const uint64_t bytes = uint64_t(double(random.magnitude(8, 25)));
      if (std::optional<Buffer> buffer = try_buffer(memory, bytes)) buffers.push_back(std::move(*buffer));
      else ++num_refused;
    }
    most_used = std::max(most_used, memory->tracker()->used());
    most_held = std::max(most_held, memory->held_bytes());
    ASSERT_LE(memory->held_bytes(), limit) << "after " << i << " steps";
  }
  // It was full, and much of it was of use.
  EXPECT_GT(num_refused, 0u);
  EXPECT_GT(most_used, 100 * mib);
  EXPECT_GE(most_held, most_used);
}

TEST_F(CudaPool, GivesBackWhatOtherSizesNeed)
{
  const auto memory = std::make_shared<DeviceMemory>(0, 160 * mib);
  std::vector<Buffer> small;
  for (int i = 0; i < 150; ++i) small.emplace_back(memory, mib, "a small buffer");
  small.clear();
  EXPECT_TRUE(try_buffer(memory, 150 * mib));
  EXPECT_LE(memory->held_bytes(), 160 * mib);
}

TEST_F(CudaPool, TakesOneBlockForALowerLimit)
{
  const auto memory = std::make_shared<DeviceMemory>(0, 3 * mib);
  EXPECT_TRUE(try_buffer(memory, 2 * mib));
  EXPECT_FALSE(try_buffer(memory, 4 * mib));
  EXPECT_LE(memory->held_bytes(), 32 * mib);
}

}  // namespace
}  // namespace gpurt
