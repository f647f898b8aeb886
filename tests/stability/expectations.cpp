// Which methods fail which rows, and why.
#include "catalogue.h"

namespace gpurt_test {

Expectation expectation(int, const Method &) { return {Expected::Pass, ""}; }

}  // namespace gpurt_test
