/* What every example does when something goes wrong: it says so in the library's own words, and ends. */
#ifndef GPURT_EXAMPLES_CHECK_H
#define GPURT_EXAMPLES_CHECK_H

#include <gpurt.h>
#include <stdio.h>
#include <stdlib.h>

/* CHECK(gpurt_...(...)) ends the program unless the call succeeds. */
#define CHECK(call) check_result((call), #call)

static inline void check_result(gpurt_result result, const char *call)
{
  if (result == GPURT_OK) return;
  fprintf(stderr, "%s\n  %s: %s\n", call, gpurt_result_name(result), gpurt_last_error());
  exit(1);
}

/* EXPECT(condition) ends the program unless the library did what the example is about. */
#define EXPECT(condition) expect_true((condition), #condition, __FILE__, __LINE__)

static inline void expect_true(int condition, const char *text, const char *file, int line)
{
  if (condition) return;
  fprintf(stderr, "%s:%d: expected %s\n", file, line, text);
  exit(1);
}

#endif
