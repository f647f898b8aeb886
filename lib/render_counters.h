// Sums of what passes counted, for backends and for frames.
#pragma once

#include "backend.h"

namespace gpurt {

void add_counters(RenderCounters &sum, const RenderCounters &other);

}  // namespace gpurt
