#include "core/accel/degenerate.h"

#include "accel/kd_build.h"

namespace gpurt {

bool is_degenerate(Vec3f a, Vec3f b, Vec3f c) { return has_no_area(a, b, c); }

}  // namespace gpurt
