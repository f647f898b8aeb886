// Which roots a bucket of the image has to look at: lists of ids, the nearest first where memory allows, found once for a pass.
#pragma once

#include <span>
#include <vector>

#include "cpu/reyes/reyes_kernel.h"

namespace gpurt {

/// Square cells of the image with the roots that may be seen in each.
class RootBuckets {
 public:
  /// Lists take at most `budget_bytes`: cells are made larger until they fit; if even one for the whole image does not,
  /// there are no lists, and every bucket looks at all roots. `reach`: pixels around a cell that its samples may lie in.
  RootBuckets(const ReyesScene &scene, const ReyesKernels &kernels, const Camera &camera, uint32_t cell_edge,
              int reach, uint64_t budget_bytes);

  /// The roots of the cell that a bucket lies in. Null where there are no lists.
  std::span<const uint32_t> roots_of(uint32_t x, uint32_t y) const;
  bool has_lists() const { return has_lists_; }
  uint64_t bytes() const { return ids_.size() * sizeof(uint32_t) + starts_.size() * sizeof(uint64_t); }
  uint64_t largest() const { return largest_; }

 private:
  struct Bounds;
  template <class Visit>
  void for_each_cell(const ReyesScene &scene, const ReyesKernels &kernels, const Camera &camera, int reach,
                     Bounds &bounds, const Visit &visit) const;

  uint32_t cell_edge_, cells_x_ = 0, cells_y_ = 0;
  bool has_lists_ = false;
  uint64_t largest_ = 0;
  std::vector<uint64_t> starts_;
  std::vector<uint32_t> ids_;
};

}  // namespace gpurt
