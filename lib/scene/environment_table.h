// The table that importance sampling of a lat-long image draws from.
#pragma once

#include "scene/compiled_scene.h"

namespace gpurt {

/// Fills environment, environment_rows and environment_columns of `scene`, whose textures are there already.
void compile_environment(const EnvironmentData &environment, CompiledScene &scene);

}  // namespace gpurt
