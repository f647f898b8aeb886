// A checked glTF document and what its readers share: the parsed structure, buffers, images, messages.
#pragma once

#include <fmt/format.h>

#include <functional>
#include <string>
#include <vector>

#define TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#define TINYGLTF_NO_FS
#define TINYGLTF_NO_EXTERNAL_IMAGE
#include <tiny_gltf.h>

#include "error.h"
#include "scene/gltf_file.h"

namespace gpurt {

/// Where an image's bytes are.
struct GltfImage {
  std::string uri;
  int buffer_view = -1;
  std::string name;
};

class GltfDocument {
 public:
  /// Reads the file, checks its schema and hands the structure to tinygltf. Buffers are loaded; images are not.
  GltfDocument(const std::string &path, std::function<void(const std::string &)> warn);

  const tinygltf::Model &model() const { return model_; }
  const GltfFile &file() const { return file_; }
  const std::vector<GltfImage> &images() const { return images_; }

  /// The bytes of a buffer view; throws where it leaves its buffer. `what` names who asks.
  ByteSpan buffer_view(int index, const std::string &what) const;
  bool uses(const std::string &extension) const;

  /// Throws IO with the file's name in front.
  template <class... Args>
  [[noreturn]] void fail(fmt::format_string<Args...> format, Args &&...args) const
  {
    throw Error(GPURT_ERROR_IO, file_.path + ": " + fmt::format(format, std::forward<Args>(args)...));
  }
  template <class... Args>
  void warn(fmt::format_string<Args...> format, Args &&...args) const
  {
    if (warn_) warn_(file_.path + ": " + fmt::format(format, std::forward<Args>(args)...));
  }

  /// Runs a call of scene/validate.h; what it refuses becomes an error of this file about `what`.
  template <class Call>
  auto checked(const std::string &what, Call &&call) const
  {
    try {
      return call();
    } catch (const Error &e) {
      if (e.result() != GPURT_ERROR_INVALID_ARGUMENT) throw;
      fail("{}: {}", what, e.what());
    }
  }

 private:
  void load_buffers(const nlohmann::json &json);

  GltfFile file_;
  std::function<void(const std::string &)> warn_;
  tinygltf::Model model_;
  std::vector<ByteSpan> buffers_;
  std::vector<GltfImage> images_;
};

/// "mesh 3 ('Body')", or "mesh 3" for one without a name.
std::string gltf_label(const char *kind, size_t index, const std::string &name);

/// A number of an extension's object, or the default.
double gltf_number(const tinygltf::Value &object, const char *key, double value_if_absent);

/// The object of an extension, or null.
const tinygltf::Value *gltf_extension(const tinygltf::ExtensionMap &extensions, const char *name);

}  // namespace gpurt
