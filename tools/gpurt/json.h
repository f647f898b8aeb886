// The public structs as JSON, with the field order of the header.
#pragma once

#include <nlohmann/json.hpp>

#include "gpurt.h"

namespace cli {

using Json = nlohmann::ordered_json;

Json to_json(const gpurt_device_properties &properties);
Json to_json(const gpurt_scene_facts &facts);
Json to_json(const gpurt_schedule &schedule);
Json to_json(const gpurt_statistics &statistics);

}  // namespace cli
