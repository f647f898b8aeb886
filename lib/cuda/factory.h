// How the registry reaches the CUDA backend. Host code: needs no CUDA header.
#pragma once

#include "backend.h"

namespace gpurt::cuda {

/// Lists the devices that the library can use, by ordinal; none where there is no driver.
const BackendFactory &factory();

}  // namespace gpurt::cuda
