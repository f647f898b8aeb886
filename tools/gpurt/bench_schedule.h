// gpurt bench schedule.
#pragma once

#include "cli.h"

namespace cli {

void add_bench_schedule_command(CLI::App &bench);

}  // namespace cli
