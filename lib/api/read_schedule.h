// Reading of gpurt_schedule, which is part of several descriptors.
#pragma once

#include "gpurt.h"
#include "schedule.h"

namespace gpurt::api {

/// Throws INVALID_ARGUMENT for values that no enumerator has and for what must be 0.
Schedule checked_schedule(const gpurt_schedule &d);

}  // namespace gpurt::api
