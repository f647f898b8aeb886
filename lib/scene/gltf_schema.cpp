#include "scene/gltf_schema.h"

#include <cmath>
#include <initializer_list>
#include <limits>

#include "error.h"

namespace gpurt {
namespace {

using nlohmann::json;

constexpr int64_t max_offset = int64_t(1) << 53;  // what JSON's numbers hold exactly
constexpr int64_t max_int = std::numeric_limits<int>::max();
constexpr int64_t max_count = 0xfffffffe;
constexpr double infinite = std::numeric_limits<double>::infinity();

// Walks a document; `where` is the path of the object at hand, such as "meshes[3].primitives[0]".
class Checker {
 public:
  explicit Checker(GltfFile &file) : path_(file.path), root_(file.json) {}

  void run()
  {
    check_asset();
    reference(root_, "", "scene", "scenes");
    strings(root_, "", "extensionsUsed");
    strings(root_, "", "extensionsRequired");
    if (json *extensions = member_object(root_, "", "extensions")) {
      if (json *punctual = member_object(*extensions, "extensions", "KHR_lights_punctual")) {
        const std::string where = "extensions.KHR_lights_punctual";
        if (!punctual->contains("lights")) complain(where + ".lights", "is missing");
        num_lights_ = member_array(*punctual, where, "lights")->size();
        each(*punctual, where, "lights", [this](json &o, const std::string &w) { check_light(o, w); });
      }
    }
    each(root_, "", "buffers", [this](json &o, const std::string &w) {
      integer(o, w, "byteLength", 1, max_offset, true);
      string(o, w, "uri");
    });
    each(root_, "", "bufferViews", [this](json &o, const std::string &w) {
      reference(o, w, "buffer", "buffers", true);
      integer(o, w, "byteOffset", 0, max_offset);
      integer(o, w, "byteLength", 1, max_offset, true);
      integer(o, w, "byteStride", 4, 252);
      if (o.contains("byteStride") && o["byteStride"].get<int64_t>() % 4 != 0) {
        complain(w + ".byteStride", "is no multiple of 4");
      }
    });
    each(root_, "", "accessors", [this](json &o, const std::string &w) { check_accessor(o, w); });
    each(root_, "", "images", [this](json &o, const std::string &w) {
      string(o, w, "uri");
      string(o, w, "mimeType");
      reference(o, w, "bufferView", "bufferViews");
      if (o.contains("uri") == o.contains("bufferView")) complain(w, "needs either a uri or a bufferView");
    });
    each(root_, "", "samplers", [this](json &o, const std::string &w) {
      one_of(o, w, "magFilter", {9728, 9729});
      one_of(o, w, "minFilter", {9728, 9729, 9984, 9985, 9986, 9987});
      one_of(o, w, "wrapS", {10497, 33071, 33648});
      one_of(o, w, "wrapT", {10497, 33071, 33648});
    });
    each(root_, "", "textures", [this](json &o, const std::string &w) {
      reference(o, w, "sampler", "samplers");
      reference(o, w, "source", "images");
    });
    each(root_, "", "materials", [this](json &o, const std::string &w) { check_material(o, w); });
    each(root_, "", "meshes", [this](json &o, const std::string &w) {
      if (!o.contains("primitives")) complain(w + ".primitives", "is missing");
      each(o, w, "primitives", [this](json &p, const std::string &pw) { check_primitive(p, pw); });
    });
    each(root_, "", "cameras", [this](json &o, const std::string &w) { check_camera(o, w); });
    each(root_, "", "nodes", [this](json &o, const std::string &w) { check_node(o, w); });
    each(root_, "", "scenes", [this](json &o, const std::string &w) { references(o, w, "nodes", "nodes"); });
  }

 private:
  [[noreturn]] void complain(const std::string &where, const std::string &what) const
  {
    fail(GPURT_ERROR_IO, "{}: {} {}", path_, printable(where), what);
  }
  // How a value looks in a message.
  static std::string show(const json &value)
  {
    if (value.is_structured()) return value.is_array() ? "an array" : "an object";
    return printable(value.dump(-1, ' ', false, json::error_handler_t::replace));
  }
  static std::string join(const std::string &where, const char *key)
  {
    return where.empty() ? key : where + "." + key;
  }

  json *member_object(json &o, const std::string &where, const char *key)
  {
    const auto it = o.find(key);
    if (it == o.end()) return nullptr;
    if (!it->is_object()) complain(join(where, key), fmt::format("is {}; it must be an object", show(*it)));
    return &*it;
  }
  json *member_array(json &o, const std::string &where, const char *key)
  {
    const auto it = o.find(key);
    if (it == o.end()) return nullptr;
    if (!it->is_array()) complain(join(where, key), fmt::format("is {}; it must be an array", show(*it)));
    return &*it;
  }
  // Calls check(object, path) for the objects of an array, and checks their names.
  template <class Check>
  void each(json &o, const std::string &where, const char *key, const Check &check)
  {
    json *array = member_array(o, where, key);
    if (!array) return;
    for (size_t i = 0; i < array->size(); ++i) {
      json &element = (*array)[i];
      const std::string w = fmt::format("{}[{}]", join(where, key), i);
      if (!element.is_object()) complain(w, fmt::format("is {}; it must be an object", show(element)));
      string(element, w, "name");
      member_object(element, w, "extensions");
      check(element, w);
    }
  }
  json *extension(json &o, const std::string &where, const char *name)
  {
    json *extensions = member_object(o, where, "extensions");
    return extensions ? member_object(*extensions, where + ".extensions", name) : nullptr;
  }

  void integer_value(json &value, const std::string &where, int64_t low, int64_t high)
  {
    const auto is_bad_real = [](double x) { return x != std::floor(x) || std::fabs(x) > double(max_offset); };
    const bool is_huge = value.is_number_unsigned() && value.get<uint64_t>() > uint64_t(max_offset);
    if (!value.is_number() || is_huge || (value.is_number_float() && is_bad_real(value.get<double>()))) {
      complain(where, fmt::format("is {}; it must be a whole number from {} to {}", show(value), low, high));
    }
    if (value.is_number_float()) value = int64_t(value.get<double>());
    const int64_t x = value.get<int64_t>();
    if (x < low || x > high) complain(where, fmt::format("is {}; it must be from {} to {}", x, low, high));
  }
  void integer(json &o, const std::string &where, const char *key, int64_t low, int64_t high,
               bool is_required = false)
  {
    const auto it = o.find(key);
    if (it != o.end()) integer_value(*it, join(where, key), low, high);
    else if (is_required) complain(join(where, key), "is missing");
  }
  void one_of(json &o, const std::string &where, const char *key, std::initializer_list<int> values,
              bool is_required = false)
  {
    integer(o, where, key, 0, max_int, is_required);
    if (!o.contains(key)) return;
    for (int v : values) {
      if (o[key] == v) return;
    }
    complain(join(where, key), fmt::format("is {}, which glTF does not know", show(o[key])));
  }
  // An index into the array `target` of the document.
  void reference_value(json &value, const std::string &where, const char *target, size_t count)
  {
    integer_value(value, where, 0, max_int);
    if (value.get<uint64_t>() >= count) {
      complain(where, fmt::format("is {}, but the file has {} {}", show(value), count, target));
    }
  }
  size_t count_of(const char *target)
  {
    const auto it = root_.find(target);
    return it != root_.end() && it->is_array() ? it->size() : 0;
  }
  void reference(json &o, const std::string &where, const char *key, const char *target,
                 bool is_required = false)
  {
    const auto it = o.find(key);
    if (it != o.end()) reference_value(*it, join(where, key), target, count_of(target));
    else if (is_required) complain(join(where, key), "is missing");
  }
  void references(json &o, const std::string &where, const char *key, const char *target)
  {
    json *array = member_array(o, where, key);
    const size_t count = count_of(target);
    for (size_t i = 0; array && i < array->size(); ++i) {
      reference_value((*array)[i], fmt::format("{}[{}]", join(where, key), i), target, count);
    }
  }

  void number_value(const json &value, const std::string &where, double low, double high)
  {
    if (!value.is_number()) complain(where, fmt::format("is {}; it must be a number", show(value)));
    const double x = value.get<double>();
    if (!std::isfinite(x)) complain(where, "is not finite");
    if (!(x >= low && x <= high)) {
      complain(where, high < infinite ? fmt::format("is {}; it must be in [{}, {}]", x, low, high)
                                      : fmt::format("is {}; it must be at least {}", x, low));
    }
  }
  void number(json &o, const std::string &where, const char *key, double low = -infinite,
              double high = infinite, bool is_required = false)
  {
    const auto it = o.find(key);
    if (it != o.end()) number_value(*it, join(where, key), low, high);
    else if (is_required) complain(join(where, key), "is missing");
  }
  void numbers(json &o, const std::string &where, const char *key, size_t count, double low = -infinite,
               double high = infinite)
  {
    json *array = member_array(o, where, key);
    if (!array) return;
    if (array->size() != count) {
      complain(join(where, key), fmt::format("has {} numbers; it must have {}", array->size(), count));
    }
    for (size_t i = 0; i < count; ++i)
      number_value((*array)[i], fmt::format("{}[{}]", join(where, key), i), low, high);
  }
  void string(json &o, const std::string &where, const char *key, bool is_required = false)
  {
    const auto it = o.find(key);
    if (it == o.end()) {
      if (is_required) complain(join(where, key), "is missing");
    } else if (!it->is_string()) {
      complain(join(where, key), fmt::format("is {}; it must be a string", show(*it)));
    }
  }
  void strings(json &o, const std::string &where, const char *key)
  {
    json *array = member_array(o, where, key);
    for (size_t i = 0; array && i < array->size(); ++i) {
      if (!(*array)[i].is_string()) complain(fmt::format("{}[{}]", join(where, key), i), "is no string");
    }
  }
  void word(json &o, const std::string &where, const char *key, std::initializer_list<const char *> words,
            bool is_required = false)
  {
    string(o, where, key, is_required);
    if (!o.contains(key)) return;
    std::string list;
    for (const char *w : words) {
      if (o[key] == w) return;
      list += list.empty() ? w : std::string(", ") + w;
    }
    complain(join(where, key), fmt::format("is {}; it must be one of {}", show(o[key]), list));
  }
  void boolean(json &o, const std::string &where, const char *key)
  {
    const auto it = o.find(key);
    if (it != o.end() && !it->is_boolean()) {
      complain(join(where, key), fmt::format("is {}; it must be true or false", show(*it)));
    }
  }

  void check_asset()
  {
    json *asset = member_object(root_, "", "asset");
    if (!asset) complain("asset", "is missing: this is no glTF 2.0 file");
    string(*asset, "asset", "version", true);
    string(*asset, "asset", "minVersion");
    const std::string version = (*asset)["version"];
    if (version.compare(0, 2, "2.") != 0) {
      complain("asset.version",
               fmt::format("is '{}'; this library reads glTF 2.0: convert the file", printable(version)));
    }
    if (asset->contains("minVersion") && (*asset)["minVersion"] != "2.0") {
      complain("asset.minVersion",
               fmt::format("is {}; this library reads glTF 2.0", show((*asset)["minVersion"])));
    }
  }

  void check_light(json &o, const std::string &w)
  {
    word(o, w, "type", {"point", "spot", "directional"}, true);
    numbers(o, w, "color", 3, 0);
    number(o, w, "intensity", 0);
    number(o, w, "range", 0);
    if (json *spot = member_object(o, w, "spot")) {
      number(*spot, w + ".spot", "innerConeAngle", 0);
      number(*spot, w + ".spot", "outerConeAngle", 0);
    } else if (o["type"] == "spot") {
      complain(w + ".spot", "is missing");
    }
  }

  void check_accessor(json &o, const std::string &w)
  {
    reference(o, w, "bufferView", "bufferViews");
    integer(o, w, "byteOffset", 0, max_offset);
    one_of(o, w, "componentType", {5120, 5121, 5122, 5123, 5125, 5126}, true);
    boolean(o, w, "normalized");
    integer(o, w, "count", 1, max_count, true);
    word(o, w, "type", {"SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"}, true);
    json *sparse = member_object(o, w, "sparse");
    if (!sparse) return;
    const std::string sw = w + ".sparse";
    integer(*sparse, sw, "count", 1, max_int, true);
    for (const char *part : {"indices", "values"}) {
      json *p = member_object(*sparse, sw, part);
      const std::string pw = join(sw, part);
      if (!p) complain(pw, "is missing");
      reference(*p, pw, "bufferView", "bufferViews", true);
      integer(*p, pw, "byteOffset", 0, max_int);
      if (std::string(part) == "indices") one_of(*p, pw, "componentType", {5121, 5123, 5125}, true);
    }
  }

  void check_texture_info(json &o, const std::string &where, const char *key)
  {
    json *info = member_object(o, where, key);
    if (!info) return;
    const std::string w = join(where, key);
    reference(*info, w, "index", "textures", true);
    integer(*info, w, "texCoord", 0, 1000);
    if (json *t = extension(*info, w, "KHR_texture_transform")) {
      const std::string tw = w + ".extensions.KHR_texture_transform";
      numbers(*t, tw, "offset", 2);
      numbers(*t, tw, "scale", 2);
      number(*t, tw, "rotation");
      integer(*t, tw, "texCoord", 0, 1000);
    }
  }

  void check_material(json &o, const std::string &w)
  {
    if (json *pbr = member_object(o, w, "pbrMetallicRoughness")) {
      const std::string pw = w + ".pbrMetallicRoughness";
      numbers(*pbr, pw, "baseColorFactor", 4, 0, 1);
      number(*pbr, pw, "metallicFactor", 0, 1);
      number(*pbr, pw, "roughnessFactor", 0, 1);
      check_texture_info(*pbr, pw, "baseColorTexture");
      check_texture_info(*pbr, pw, "metallicRoughnessTexture");
    }
    for (const char *key : {"normalTexture", "occlusionTexture", "emissiveTexture"})
      check_texture_info(o, w, key);
    numbers(o, w, "emissiveFactor", 3, 0, 1);
    word(o, w, "alphaMode", {"OPAQUE", "MASK", "BLEND"});
    number(o, w, "alphaCutoff", 0);
    boolean(o, w, "doubleSided");
    const auto factor = [&](const char *name, const char *key, double high) {
      if (json *e = extension(o, w, name)) number(*e, fmt::format("{}.extensions.{}", w, name), key, 0, high);
    };
    factor("KHR_materials_emissive_strength", "emissiveStrength", infinite);
    factor("KHR_materials_ior", "ior", infinite);
    factor("KHR_materials_specular", "specularFactor", 1);
    factor("KHR_materials_transmission", "transmissionFactor", 1);
    factor("KHR_materials_volume", "thicknessFactor", infinite);
    if (json *e = extension(o, w, "KHR_materials_volume")) {
      const std::string vw = w + ".extensions.KHR_materials_volume";
      number(*e, vw, "attenuationDistance", std::numeric_limits<float>::min());
      numbers(*e, vw, "attenuationColor", 3, 0, 1);
    }
  }

  void check_primitive(json &o, const std::string &w)
  {
    json *attributes = member_object(o, w, "attributes");
    if (!attributes) complain(w + ".attributes", "is missing");
    const size_t num_accessors = count_of("accessors");
    for (auto &[name, value] : attributes->items()) {
      reference_value(value, fmt::format("{}.attributes.{}", w, name), "accessors", num_accessors);
    }
    reference(o, w, "indices", "accessors");
    reference(o, w, "material", "materials");
    integer(o, w, "mode", 0, 6);
    member_array(o, w, "targets");
    if (json *patches = extension(o, w, "GPURT_bezier_patches")) {
      reference(*patches, w + ".extensions.GPURT_bezier_patches", "controlPoints", "accessors", true);
    }
  }

  void check_camera(json &o, const std::string &w)
  {
    word(o, w, "type", {"perspective", "orthographic"}, true);
    if (o["type"] == "perspective") {
      json *p = member_object(o, w, "perspective");
      if (!p) complain(w + ".perspective", "is missing");
      number(*p, w + ".perspective", "yfov", 0, infinite, true);
      number(*p, w + ".perspective", "znear", 0, infinite, true);
    } else {
      json *p = member_object(o, w, "orthographic");
      if (!p) complain(w + ".orthographic", "is missing");
      for (const char *key : {"xmag", "ymag", "zfar", "znear"})
        number(*p, w + ".orthographic", key, -infinite, infinite, true);
    }
    if (o.contains("extras") && o["extras"].is_object()) {
      integer(o["extras"], w + ".extras", "width", 0, max_int);
      integer(o["extras"], w + ".extras", "height", 0, max_int);
    }
  }

  void check_node(json &o, const std::string &w)
  {
    references(o, w, "children", "nodes");
    reference(o, w, "mesh", "meshes");
    reference(o, w, "camera", "cameras");
    numbers(o, w, "matrix", 16);
    numbers(o, w, "translation", 3);
    numbers(o, w, "rotation", 4);
    numbers(o, w, "scale", 3);
    if (json *light = extension(o, w, "KHR_lights_punctual")) {
      const std::string lw = w + ".extensions.KHR_lights_punctual.light";
      if (!light->contains("light")) complain(lw, "is missing");
      reference_value((*light)["light"], lw, "lights", num_lights_);
    }
  }

  const std::string &path_;
  json &root_;
  size_t num_lights_ = 0;
};

}  // namespace

void check_gltf_schema(GltfFile &file) { Checker(file).run(); }

}  // namespace gpurt
