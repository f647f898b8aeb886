// The library reports the version it was built as.
#include "gpurt.h"

#include <gtest/gtest.h>

TEST(Version, IsThatOfTheHeader)
{
  EXPECT_EQ(gpurt_version(), 0u << 16 | 1u << 8 | 0u);
}
