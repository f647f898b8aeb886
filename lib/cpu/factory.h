// How the registry reaches the CPU backend.
#pragma once

#include "backend.h"

namespace gpurt::cpu {

/// Lists one device and makes backends for it; ordinal is 0.
const BackendFactory &factory();

}  // namespace gpurt::cpu
