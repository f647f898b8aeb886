// The library reports the version it was built as.
#include "gpurt.h"

#include <gtest/gtest.h>

TEST(Version, IsThatOfTheHeader)
{
  EXPECT_EQ(gpurt_version(), GPURT_VERSION_MAJOR << 16 | GPURT_VERSION_MINOR << 8 | GPURT_VERSION_PATCH);
}
