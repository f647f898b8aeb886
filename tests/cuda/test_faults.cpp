// Faults on a device, as a caller's pointer to memory that is not there makes them: a result and a text, now and from every
// later call, and never a crash or a call that does not return.
//
// A fault ends the process' work on the device. So each test is a process of its own, begun by GoogleTest, and it ends as
// programs do: objects are released, and the process runs its exit handlers.
#include <cuda.h>
#include <cuda_runtime_api.h>
#include <dlfcn.h>
#include <unistd.h>

#include <cstdlib>
#include <thread>

#include "gpurt_cuda.h"
#include "pictures.h"

namespace gpurt_test {
namespace {

// Runs the test in a process of its own, which has a minute.
void expect_success_alone(void (*test)())
{
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const auto run = [test] {
    alarm(60);
    test();
    std::exit(testing::Test::HasFailure() ? 1 : 0);
  };
  EXPECT_EXIT(run(), testing::ExitedWithCode(0), "");
}

// A function of the driver, which programs do not link.
template <class Function>
Function *driver_function(const char *name)
{
  static void *const driver = dlopen("libcuda.so.1", RTLD_NOW);
  auto *const function = driver != nullptr ? reinterpret_cast<Function *>(dlsym(driver, name)) : nullptr;
  EXPECT_NE(function, nullptr) << name;
  return function;
}
#define DRIVER(function) driver_function<decltype(function)>(#function)

// Rays in device memory, of which only the first half is there: an address that is right, and a number that is not.
struct HalfOfRays {
  const gpurt_ray *rays = nullptr;
  uint64_t num_rays = 0;

  HalfOfRays()
  {
    EXPECT_EQ(cudaFree(nullptr), cudaSuccess);  // makes the context
    CUmemAllocationProp properties{};
    properties.type = CU_MEM_ALLOCATION_TYPE_PINNED;
    properties.location = {CU_MEM_LOCATION_TYPE_DEVICE, {0}};
    size_t bytes = 0;
    EXPECT_EQ(DRIVER(cuMemGetAllocationGranularity)(&bytes, &properties, CU_MEM_ALLOC_GRANULARITY_MINIMUM),
              CUDA_SUCCESS);
    CUdeviceptr address = 0;
    CUmemGenericAllocationHandle half = 0;
    EXPECT_EQ(DRIVER(cuMemAddressReserve)(&address, 2 * bytes, 0, 0, 0), CUDA_SUCCESS);
    EXPECT_EQ(DRIVER(cuMemCreate)(&half, bytes, &properties, 0), CUDA_SUCCESS);
    EXPECT_EQ(DRIVER(cuMemMap)(address, bytes, 0, half, 0), CUDA_SUCCESS);
    const CUmemAccessDesc access{properties.location, CU_MEM_ACCESS_FLAGS_PROT_READWRITE};
    EXPECT_EQ(DRIVER(cuMemSetAccess)(address, bytes, &access, 1), CUDA_SUCCESS);
    rays = reinterpret_cast<const gpurt_ray *>(address);
    num_rays = 2 * bytes / sizeof(gpurt_ray);
  }
};

// Everything that a device has, made while it works.
class Objects {
 public:
  Objects()
      : device(make_device(GPURT_DEVICE_CUDA)),
        scene(make_scene(device, fill_cornell_box, GPURT_ACCEL_BVH)),
        frame(make_frame(scene, size)),
        large(make_frame(scene, large_size))
  {
    GPURT_EXPECT_OK(gpurt_device_enumerate(nullptr, 0, &num_devices_));
    gpurt_buffer_desc buffer_desc = GPURT_BUFFER_DESC_INIT;
    buffer_desc.storage = GPURT_STORAGE_DEVICE;
    buffer_desc.size_bytes = half.num_rays * sizeof(gpurt_hit);
    GPURT_EXPECT_OK(gpurt_buffer_create(device, &buffer_desc, &buffer));
    uint64_t bytes = 0;
    void *data = nullptr;
    GPURT_EXPECT_OK(gpurt_buffer_get_data(buffer, &data, &bytes));
    bad.storage = GPURT_STORAGE_DEVICE;
    bad.num_rays = half.num_rays;
    bad.rays = half.rays;
    bad.hits = data;
    EXPECT_EQ(gpurt_photon_map_create(device, &points_desc(), &photons), GPURT_OK) << gpurt_last_error();
    EXPECT_EQ(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking), cudaSuccess);
    render(frame, size);
    render(large, large_size);
  }

  // What the first failure says is what all say.
  void expect_loss(gpurt_result result)
  {
    EXPECT_EQ(result, GPURT_ERROR_DEVICE) << gpurt_result_name(result);
    const std::string text = gpurt_last_error();
    if (text_.empty()) text_ = text;
    EXPECT_EQ(text, text_);
    EXPECT_NE(text.find("cudaErrorIllegalAddress"), std::string::npos) << text;
    EXPECT_NE(text.find("CUDA device 0 is lost"), std::string::npos) << text;
    EXPECT_NE(text.find("start the process again"), std::string::npos) << text;
  }

  gpurt_result submit(gpurt_pipeline pipeline, uint32_t spp, Job &job) const
  {
    // Of its own: samples of one pipeline are not continued by another.
    const Frame target = make_frame(scene, size);
    gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
    desc.pipeline = pipeline;
    desc.samples_per_pixel = spp;
    return gpurt_frame_submit(target, &desc, nullptr, 0, job.out());
  }

  void expect_loss_from_every_call()
  {
    gpurt_hit hit;
    const gpurt_ray ray{{0, 0, 3}, 0, {0, 0, -1}, 10};
    gpurt_trace_desc trace = GPURT_TRACE_DESC_INIT;
    trace.num_rays = 1;
    trace.rays = &ray;
    trace.hits = &hit;
    expect_loss(gpurt_scene_trace(scene, &trace));
    expect_loss(gpurt_cuda_trace(scene, &bad, stream, nullptr, nullptr));
    expect_loss(gpurt_cuda_wait(device, 0, stream));
    expect_loss(gpurt_cuda_order(device, 0, nullptr, stream));
    for (gpurt_accel accel : {GPURT_ACCEL_AUTO, GPURT_ACCEL_BVH, GPURT_ACCEL_KDTREE}) {
      gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
      build.accel = accel;
      expect_loss(gpurt_scene_commit(scene, &build));
    }
    for (gpurt_pipeline pipeline : {GPURT_PIPELINE_PATH, GPURT_PIPELINE_PHOTON, GPURT_PIPELINE_REYES}) {
      Job job;
      gpurt_result result = submit(pipeline, 16, job);
      if (result == GPURT_OK) result = gpurt_job_wait(job, GPURT_WAIT_FOREVER);
      expect_loss(result);
    }
    char byte = 0;
    expect_loss(gpurt_buffer_read(buffer, 0, &byte, 1));
    expect_loss(gpurt_buffer_write(buffer, 0, &byte, 1));
    gpurt_buffer_desc buffer_desc = GPURT_BUFFER_DESC_INIT;
    buffer_desc.storage = GPURT_STORAGE_DEVICE;
    buffer_desc.size_bytes = 64;
    gpurt_buffer no_buffer = nullptr;
    expect_loss(gpurt_buffer_create(device, &buffer_desc, &no_buffer));
    gpurt_photon_map no_map = nullptr;
    expect_loss(gpurt_photon_map_create(device, &points_desc(), &no_map));
    float place[3] = {0, 0, 0};
    uint32_t count = 0;
    gpurt_photon_query_desc query = GPURT_PHOTON_QUERY_DESC_INIT;
    query.num_queries = 1;
    query.positions = place;
    query.counts = &count;
    query.radius = 0.5f;
    expect_loss(gpurt_photon_map_query(photons, &query));
    gpurt_device_desc desc = GPURT_DEVICE_DESC_INIT;
    desc.type = GPURT_DEVICE_CUDA;
    Device none;
    expect_loss(gpurt_device_create(&desc, none.out()));
  }

  // What does not take the device: its properties, the frame that was done before, the CPU, and releasing it all.
  void expect_that_the_rest_works()
  {
    gpurt_device_properties properties = GPURT_DEVICE_PROPERTIES_INIT;
    GPURT_EXPECT_OK(gpurt_device_get_properties(device, &properties));
    uint32_t count = 0;
    GPURT_EXPECT_OK(gpurt_device_enumerate(nullptr, 0, &count));
    EXPECT_EQ(count, num_devices_);
    EXPECT_GT(mean(read_color(frame, size)), 0.0);
    const Device cpu = make_device(GPURT_DEVICE_CPU, 2);
    const Scene box = make_scene(cpu, fill_cornell_box, GPURT_ACCEL_BVH);
    const Frame same = make_frame(box, size);
    render(same, size);
    EXPECT_EQ(read_color(same, size), read_color(frame, size));
    expect_that_a_loss_is_told_once();
    if (num_cuda_devices() == 1) {
      const Device automatic = make_device(GPURT_DEVICE_AUTO);
      GPURT_EXPECT_OK(gpurt_device_get_properties(automatic, &properties));
      EXPECT_EQ(properties.type, GPURT_DEVICE_CPU);
    }
    GPURT_EXPECT_OK(gpurt_photon_map_release(photons));
    GPURT_EXPECT_OK(gpurt_buffer_release(buffer));
    frame = Frame();
    large = Frame();
    scene = Scene();
    device = Device();
  }

  // Sums of a large frame may be on the device alone: the first call that needs them says that they are lost.
  void expect_that_a_loss_is_told_once()
  {
    std::vector<uint32_t> counts(size_t(large_size.width) * large_size.height, 7);
    const auto read = [&] {
      return gpurt_frame_read(large, GPURT_OUTPUT_SAMPLE_COUNT, counts.data(),
                              counts.size() * sizeof(uint32_t));
    };
    const gpurt_result first = read();
    if (first != GPURT_OK) {
      EXPECT_EQ(first, GPURT_ERROR_DEVICE) << gpurt_result_name(first);
      const std::string text = gpurt_last_error();
      EXPECT_NE(text.find("CUDA device 0 is lost"), std::string::npos) << text;
      EXPECT_NE(text.find("it goes back to the 0 that the host has"), std::string::npos) << text;
      GPURT_EXPECT_OK(read());
    }
    const uint32_t expected = first == GPURT_OK ? large_size.spp : 0;
    EXPECT_EQ(counts, std::vector<uint32_t>(counts.size(), expected));
  }

  RenderOptions size{.width = 48, .height = 32, .spp = 4}, large_size{.width = 400, .height = 300, .spp = 1};
  Device device;
  Scene scene;
  Frame frame, large;
  HalfOfRays half;
  gpurt_buffer buffer = nullptr;
  gpurt_photon_map photons = nullptr;
  cudaStream_t stream = nullptr;
  gpurt_trace_desc bad = GPURT_TRACE_DESC_INIT;  // makes the fault

 private:
  static const gpurt_photon_map_desc &points_desc()
  {
    static const float points[4][3] = {{0, 0, 0}, {0.1f, 0, 0}, {0, 0.2f, 0}, {1, 1, 1}};
    static gpurt_photon_map_desc desc = GPURT_PHOTON_MAP_DESC_INIT;
    desc.num_points = 4;
    desc.positions = points[0];
    return desc;
  }

  uint32_t num_devices_ = 0;
  std::string text_;
};

TEST(CudaFaults, OfAQueryAreErrorsOfItAndOfEveryLaterCall)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  expect_success_alone([] {
    Objects objects;
    objects.expect_loss(gpurt_scene_trace(objects.scene, &objects.bad));
    objects.expect_loss_from_every_call();
    objects.expect_that_the_rest_works();
  });
}

TEST(CudaFaults, OnAStreamOfTheCallerAreErrorsOfWaitingForIt)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  expect_success_alone([] {
    Objects objects;
    GPURT_EXPECT_OK(gpurt_cuda_trace(objects.scene, &objects.bad, objects.stream, nullptr, nullptr));
    objects.expect_loss(gpurt_cuda_wait(objects.device, 0, objects.stream));
    objects.expect_loss_from_every_call();
    objects.expect_that_the_rest_works();
  });
}

// Jobs whose device is lost while they run end, with the reason.
template <gpurt_pipeline Pipeline>
void expect_jobs_to_end()
{
  expect_success_alone([] {
    Objects objects;
    Job running, waiting;
    GPURT_EXPECT_OK(objects.submit(Pipeline, 1 << 24, running));
    GPURT_EXPECT_OK(objects.submit(Pipeline, 1 << 24, waiting));
    EXPECT_EQ(gpurt_job_wait(running, 300'000'000), GPURT_ERROR_TIMEOUT) << gpurt_last_error();
    GPURT_EXPECT_OK(gpurt_cuda_trace(objects.scene, &objects.bad, objects.stream, nullptr, nullptr));
    objects.expect_loss(gpurt_job_wait(running, GPURT_WAIT_FOREVER));
    objects.expect_loss(gpurt_job_wait(waiting, GPURT_WAIT_FOREVER));
    running = Job();
    waiting = Job();
    objects.expect_that_the_rest_works();
  });
}

TEST(CudaFaults, EndJobsOfPaths)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  expect_jobs_to_end<GPURT_PIPELINE_PATH>();
}

TEST(CudaFaults, EndJobsOfPhotons)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  expect_jobs_to_end<GPURT_PIPELINE_PHOTON>();
}

TEST(CudaFaults, EndJobsOfReyes)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  expect_jobs_to_end<GPURT_PIPELINE_REYES>();
}

// What is wrong with a call and can be seen is refused, and the device works as before.
TEST(CudaFaults, AreNotMadeByMistakesThatCanBeSeen)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  Objects objects;
  void *freed = nullptr;
  ASSERT_EQ(cudaMalloc(&freed, uint64_t(64) << 20), cudaSuccess);
  ASSERT_EQ(cudaFree(freed), cudaSuccess);
  gpurt_trace_desc desc = objects.bad;
  desc.rays = static_cast<const gpurt_ray *>(freed);
  EXPECT_EQ(gpurt_scene_trace(objects.scene, &desc), GPURT_ERROR_INVALID_ARGUMENT);
  EXPECT_NE(std::string(gpurt_last_error()).find("rays"), std::string::npos) << gpurt_last_error();
  EXPECT_NE(std::string(gpurt_last_error()).find("freed"), std::string::npos) << gpurt_last_error();
  desc = objects.bad;
  desc.num_rays /= 2;  // those that are there
  EXPECT_EQ(cudaMemset(const_cast<gpurt_ray *>(desc.rays), 0, desc.num_rays * sizeof(gpurt_ray)),
            cudaSuccess);
  GPURT_EXPECT_OK(gpurt_scene_trace(objects.scene, &desc));
  EXPECT_EQ(cudaStreamDestroy(objects.stream), cudaSuccess);
  EXPECT_GT(trace_closest(objects.scene, {{{0, 0, 3}, 0, {0, 0, -1}, 10}})[0].t, 0.0f);
  GPURT_EXPECT_OK(gpurt_photon_map_release(objects.photons));
  GPURT_EXPECT_OK(gpurt_buffer_release(objects.buffer));
}

}  // namespace
}  // namespace gpurt_test
