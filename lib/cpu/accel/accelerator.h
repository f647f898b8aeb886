// What the CPU backend asks of an acceleration structure: the kd-tree, the bvh or Embree.
#pragma once

#include <functional>

#include "backend.h"
#include "cpu/accel/cpu_accel.h"
#include "cpu/accel/kd_view.h"

namespace gpurt {

class Accelerator {
 public:
  virtual ~Accelerator() = default;
  /// Valid while this lives.
  virtual const CpuAccel &queries() const = 0;
  /// Calls sink(user, hit) for every crossing, unsorted; a triangle may come several times.
  virtual void all(const Ray &ray, void *user, void (*sink)(void *user, const Hit &hit)) const = 0;
  virtual const AccelFacts &facts() const = 0;
  /// Throws INVALID_ARGUMENT where there is no such kd-tree.
  virtual HostKdTree export_tree(uint32_t tree) const = 0;
};

/// What a build may use.
struct AccelContext {
  std::shared_ptr<const CompiledScene> scene;
  std::shared_ptr<MemoryTracker> memory;
  uint32_t num_threads;
  std::function<void(gpurt_log_level, const std::string &)> log;
};

/// All build on the threads of the calling task arena.
std::unique_ptr<Accelerator> make_kd_accelerator(const AccelContext &context, const BuildOptions &options);
std::unique_ptr<Accelerator> make_bvh_accelerator(const AccelContext &context, const BuildOptions &options);
std::unique_ptr<Accelerator> make_embree_accelerator(const AccelContext &context,
                                                     const BuildOptions &options);

}  // namespace gpurt
