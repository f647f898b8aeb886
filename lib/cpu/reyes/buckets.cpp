#include "cpu/reyes/buckets.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>

namespace gpurt {

namespace {

constexpr uint32_t roots_per_block = 256;

uint64_t num_roots(const ReyesScene &scene)
{
  return scene.num_ranges == 0 ? 0 : scene.ranges[scene.num_ranges].first_root;
}

}  // namespace

// Bounds of all roots, where there is room for them: they are asked for twice at least.
struct RootBuckets::Bounds {
  std::vector<RasterBox> boxes;
  std::vector<float> least_w;
  bool are_known = false;
};

// Calls visit(root, cell) for every cell that a root may be seen in.
template <class Visit>
void RootBuckets::for_each_cell(const ReyesScene &scene, const ReyesKernels &kernels, const Camera &camera,
                                int reach, Bounds &bounds, const Visit &visit) const
{
  const uint64_t n = num_roots(scene);
  tbb::parallel_for(tbb::blocked_range<uint64_t>(0, (n + roots_per_block - 1) / roots_per_block),
                    [&](const tbb::blocked_range<uint64_t> &range) {
                      RasterBox few_boxes[roots_per_block];
                      float few_least_w[roots_per_block];
                      for (uint64_t block = range.begin(); block != range.end(); ++block) {
                        const uint64_t first = block * roots_per_block;
                        const uint32_t count = uint32_t(std::min<uint64_t>(roots_per_block, n - first));
                        const bool is_kept = !bounds.boxes.empty();
                        RasterBox *boxes = is_kept ? bounds.boxes.data() + first : few_boxes;
                        float *least_w = is_kept ? bounds.least_w.data() + first : few_least_w;
                        if (!bounds.are_known) kernels.bound(scene, camera, first, count, boxes, least_w);
                        for (uint32_t i = 0; i < count; ++i) {
                          const RasterBox &b = boxes[i];
                          if (b.x0 > b.x1 || b.y0 > b.y1) continue;
                          const uint32_t x0 = uint32_t(std::max(b.x0 - reach, 0)) / cell_edge_;
                          const uint32_t y0 = uint32_t(std::max(b.y0 - reach, 0)) / cell_edge_;
                          const uint32_t x1 = std::min(uint32_t(b.x1 + reach) / cell_edge_, cells_x_ - 1);
                          const uint32_t y1 = std::min(uint32_t(b.y1 + reach) / cell_edge_, cells_y_ - 1);
                          for (uint32_t y = y0; y <= y1; ++y) {
                            for (uint32_t x = x0; x <= x1; ++x)
                              visit(uint32_t(first + i), uint64_t(y) * cells_x_ + x);
                          }
                        }
                      }
                    });
  bounds.are_known = !bounds.boxes.empty();
}

RootBuckets::RootBuckets(const ReyesScene &scene, const ReyesKernels &kernels, const Camera &camera,
                         uint32_t cell_edge, int reach, uint64_t budget_bytes)
    : cell_edge_(cell_edge)
{
  std::vector<std::atomic<uint64_t>> counts;
  Bounds bounds;
  const uint64_t n = num_roots(scene);
  if (n * (sizeof(RasterBox) + sizeof(float)) <= budget_bytes / 4) {
    bounds.boxes.resize(n);
    bounds.least_w.resize(n);
  }
  for (;; cell_edge_ *= 2) {
    cells_x_ = (camera.width + cell_edge_ - 1) / cell_edge_;
    cells_y_ = (camera.height + cell_edge_ - 1) / cell_edge_;
    const uint64_t num_cells = uint64_t(cells_x_) * cells_y_;
    counts = std::vector<std::atomic<uint64_t>>(num_cells);
    for_each_cell(scene, kernels, camera, reach, bounds,
                  [&](uint32_t, uint64_t cell) { counts[cell].fetch_add(1, std::memory_order_relaxed); });
    uint64_t total = 0;
    for (const auto &c : counts) total += c;
    if (total * sizeof(uint32_t) + num_cells * 2 * sizeof(uint64_t) <= budget_bytes) break;
    if (num_cells == 1) return;
  }
  has_lists_ = true;
  starts_.resize(counts.size() + 1);
  uint64_t sum = 0;
  for (size_t c = 0; c < counts.size(); ++c) {
    starts_[c] = sum;
    largest_ = std::max<uint64_t>(largest_, counts[c]);
    sum += counts[c];
    counts[c] = starts_[c];
  }
  starts_.back() = sum;
  ids_.resize(sum);
  for_each_cell(scene, kernels, camera, reach, bounds, [&](uint32_t root, uint64_t cell) {
    ids_[counts[cell].fetch_add(1, std::memory_order_relaxed)] = root;
  });
  // Threads filled them in any order. What is near hides the others: it comes first where bounds are known.
  const float *const least_w = bounds.are_known ? bounds.least_w.data() : nullptr;
  tbb::parallel_for(size_t(0), starts_.size() - 1, [&](size_t c) {
    std::sort(ids_.begin() + ptrdiff_t(starts_[c]), ids_.begin() + ptrdiff_t(starts_[c + 1]),
              [=](uint32_t a, uint32_t b) {
                if (least_w != nullptr && least_w[a] != least_w[b]) return least_w[a] < least_w[b];
                return a < b;
              });
  });
}

std::span<const uint32_t> RootBuckets::roots_of(uint32_t x, uint32_t y) const
{
  if (!has_lists_) return {};
  const uint64_t cell = uint64_t(y / cell_edge_) * cells_x_ + x / cell_edge_;
  return {ids_.data() + starts_[cell], size_t(starts_[cell + 1] - starts_[cell])};
}

}  // namespace gpurt
