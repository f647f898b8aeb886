// Several devices that work as one.
#pragma once

#include "backend.h"

namespace gpurt::multi {

/// Joins devices of one type, which have taken no memory yet. A scene is committed on each of them at the same time; they
/// draw the work of a pass, or of a batch of rays in host memory, from one queue, in parts that shrink towards its end. The
/// results have the bits of one device. Errors name the device that they come from.
std::unique_ptr<Backend> join(std::vector<std::unique_ptr<Backend>> backends);

}  // namespace gpurt::multi
