#ifndef GPURT_H
#define GPURT_H

#include <stdint.h>

#if defined(__GNUC__)
#define GPURT_API __attribute__((visibility("default")))
#else
#define GPURT_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

/** The library's version: major << 16 | minor << 8 | patch. Threads: any. */
GPURT_API uint32_t gpurt_version(void);

#ifdef __cplusplus
}
#endif

#endif /* GPURT_H */
