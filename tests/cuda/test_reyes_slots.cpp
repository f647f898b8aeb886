// Slots of the nearest fragments: the fixed A-buffer, and peeling where a sample has more fragments than memory holds, have the
// bits and the losses of the CPU.
#include "kernel_launches.h"
#include "reyes_blending_scenes.h"

namespace gpurt_test {
namespace {

std::vector<ReyesPicture> pictures()
{
  const uint32_t side = uint32_t(amount(80, 24));
  std::vector<ReyesPicture> list;
  for (const uint32_t slots : {1, 2, 7}) {
    list.push_back(reyes_picture(side, side, 9));
    list.push_back(reyes_picture(side, side, 4, 1.0f, GPURT_REYES_FILTER_MITCHELL, slots % 2));
    for (size_t i = list.size() - 2; i < list.size(); ++i) {
      list[i].options.reyes.fragment_slots = slots;
      list[i].options.reyes.no_shadows = slots != 2;
    }
  }
  return list;
}

void compare_slots(gpurt_device reference, gpurt_device tested)
{
  compare_devices(reference, tested, fill_shells, pictures());
  compare_devices(reference, tested, fill_bare_shells, {pictures()[2]});
  std::vector<ReyesPicture> list = pictures();
  if (is_short_form()) list = {list[1], list[2], list[4]};
  compare_devices(reference, tested, fill_shells_and_meshes, list);
  // Textures that let everything through in places: what shows nothing takes no slot.
  for (ReyesPicture &p : list) p.camera = 0;
  compare_devices(reference, tested, fill_veiled_everything, list);
}

TEST(CudaReyesSlots, HaveTheBitsAndTheLossesOfTheCpu)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  compare_slots(make_device(GPURT_DEVICE_CPU), make_device(GPURT_DEVICE_CUDA));
}

TEST(ReyesSlots, DoNotDependOnTheNumberOfThreads)
{
  compare_slots(make_device(GPURT_DEVICE_CPU, 1), make_device(GPURT_DEVICE_CPU, 0));
}

TEST(CudaReyesSlots, AreTheSameEveryTimeAndInLittleMemory)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  const Scene scene = scene_of(device, fill_sheets<300, 10>);
  ReyesPicture p = reyes_picture(40, 40, 9);
  p.options.reyes.fragment_slots = 16;
  gpurt_statistics first = GPURT_STATISTICS_INIT, again = GPURT_STATISTICS_INIT;
  const std::vector<OutputBits> bits = bits_of(scene, p, &first);
  EXPECT_GT(first.reyes_counters.num_lost_fragments, 0u);
  for (uint64_t i = 0; i < amount(10, 2); ++i) {
    expect_same(bits, bits_of(scene, p, &again));
    EXPECT_EQ(again.reyes_counters.num_lost_fragments, first.reyes_counters.num_lost_fragments);
  }
  EXPECT_LT(shrink_memory(fill_sheets<300, 10>, p, bits, first.reyes_counters.num_lost_fragments,
                          {32768, 8192, 3072, 2048, 1536}),
            uint64_t(4) << 20);
}

// Launches of kernels for slots, which are those of peeling where the tests around it ask for none.
uint64_t launches_in_slots(gpurt_device device)
{
  uint64_t n = 0;
  for (const char *name : {"REYES stage 'sample', fragments of triangles in slots",
                           "REYES stage 'sample', fragments of large triangles in slots",
                           "REYES stages 'dice' and 'sample', fragments in slots"}) {
    n += launches_of(device, name);
  }
  return n;
}

// Images in less and less memory, until samples have more fragments than there is room for, and they are peeled.
template <class Fill>
void peel(const Fill &fill, const ReyesPicture &p)
{
  const Scene cpu = scene_of(make_device(GPURT_DEVICE_CPU), fill);
  const Device any = make_device(GPURT_DEVICE_CUDA);
  const uint64_t before = launches_in_slots(any);
  const uint64_t least =
      shrink_memory(fill, p, bits_of(cpu, p), 0, {4096, 512, 448, 384, 352, 320, 288, 256});
  EXPECT_LT(least, uint64_t(1) << 20);
  EXPECT_GT(launches_in_slots(any), before);
}

// Thousands of layers, more than there is room for at the least.
TEST(CudaReyesBlending, PeelsWhatHasNoRoom)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  ReyesPicture p = reyes_picture(2, 2, 2);
  p.options.reyes.no_shadows = 1;
  peel(fill_sheets<4500, 1>, p);
}

// Each depth six times over: what is kept at a time ends within equals. And rays, which do not get through many.
TEST(CudaReyesBlending, PeelsPatchesAndTies)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const auto fill = [](gpurt_scene scene) {
    const uint32_t panes[] = {add_pane(scene, {0.9f, 0.5f, 0.1f}, 0.05f),
                              add_pane(scene, {0.1f, 0.5f, 0.9f}, 0.05f)};
    for (const uint32_t pane : panes) {
      std::vector<PatchNet> nets;
      for (int k = 0; k < 2200; ++k)
        nets.push_back(flat_patch({-2, -2, -0.004f * float(k / 3)}, {4, 0, 0}, {0, 4, 0}));
      add_patches(scene, nets, pane);
    }
    add_sun(scene);
    add_camera(scene, {0, 0, 3}, 0.8f);
  };
  peel(fill, reyes_picture(2, 2, 2, 4.0f));
}

}  // namespace
}  // namespace gpurt_test
