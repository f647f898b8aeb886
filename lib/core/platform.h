// What the host and device compilers disagree on, and the namespace rule of lib/core.
//
// Types of lib/core are plain aggregates in namespace gpurt: one definition everywhere. Functions stand between
// GPURT_FUNCTIONS_BEGIN and GPURT_FUNCTIONS_END: an inline namespace named after the instruction set that the
// translation unit is compiled for, so that the linker never mixes variants of the same function.
#pragma once

#include <cstddef>
#include <cstdint>

#if defined(__CUDACC__)
#define GPURT_HD __host__ __device__
#else
#define GPURT_HD
#endif

#define GPURT_INLINE GPURT_HD inline __attribute__((always_inline))
// For what is rare amid what is not: a call, which takes no registers from the rest.
#define GPURT_OUTLINE GPURT_HD inline __attribute__((noinline))

#ifndef GPURT_ISA
#define GPURT_ISA generic
#endif
#define GPURT_FUNCTIONS_BEGIN inline namespace GPURT_ISA {
#define GPURT_FUNCTIONS_END }

// A broken invariant of our own code; off in release. Caller mistakes are results, never asserts.
#if defined(GPURT_ASSERTS)
#include <cassert>
#define GPURT_ASSERT(condition) assert(condition)
#else
#define GPURT_ASSERT(condition) ((void)0)
#endif

namespace gpurt {

constexpr uint32_t invalid_id = 0xffffffffu;

}  // namespace gpurt
