// A glTF binary file with other materials, or with its models several times, for benchmarks.
#pragma once

#include <string>

struct SceneVariant {
  float alpha = 1;  // below 1: all materials blend
  float rough_metal =
      0;  // above 0: all materials are metals of this roughness, with their colours: one GGX lobe
  unsigned copies = 1;  // of every geometry of more than one patch, beside and behind each other

  bool is_plain() const { return alpha >= 1 && rough_metal <= 0 && copies <= 1; }
};

/// Writes the variant of a .glb file to a temporary file, which the caller removes, and returns its path. Ends the program with
/// what is wrong where the file cannot be read or is none.
std::string write_variant(const std::string &path, const SceneVariant &variant);
