// The scenes that gpurt scene makes. One file each; they follow the conventions of the renderer's glTF loader.
#pragma once

#include "glb_writer.h"

namespace cli::scenes {

struct SceneOptions {
  int width = 0, height = 0;  // of the camera; 0: the scene's own
  double detail = 1;          // scales the number of triangles along an edge
  std::string stem;           // of the file's name, for files that go beside it
};

void make_cornell(GlbWriter &glb, const SceneOptions &options);
void make_glass(GlbWriter &glb, const SceneOptions &options);
void make_outdoor(GlbWriter &glb, const SceneOptions &options);
void make_furnace(GlbWriter &glb, const SceneOptions &options);
void make_icosphere(GlbWriter &glb, const SceneOptions &options);

/// Adds the camera in the size that was asked for.
void add_scene_camera(GlbWriter &glb, const SceneOptions &options, const Matrix &matrix, double yfov_rad,
                      int width, int height);

}  // namespace cli::scenes
