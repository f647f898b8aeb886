// Statistics as JSON and as a few lines for people.
#pragma once

#include <string>
#include <vector>

#include "cli.h"

namespace cli {

gpurt_statistics statistics_of(gpurt_frame frame);

/// Writes a file that appears whole or not at all.
void write_file(const std::string &path, const std::string &content);

void write_statistics(const std::string &path, const std::string &scene_path, gpurt_device device,
                      gpurt_scene scene, gpurt_frame frame);
void print_summary(gpurt_device device, gpurt_frame frame, const std::vector<std::string> &outputs,
                   const std::string &state);

}  // namespace cli
