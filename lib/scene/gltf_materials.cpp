#include "scene/gltf_materials.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "scene/trigonometry.h"

namespace gpurt {
namespace {

// Below this a metal is as good as a mirror: its highlight is narrower than floats resolve.
constexpr double mirror_roughness = 1e-4;

// Extensions that are read, or that metals and glass have no use for.
const std::set<std::string> known_extensions = {"KHR_materials_emissive_strength", "KHR_materials_ior",
                                                "KHR_materials_specular", "KHR_materials_transmission",
                                                "KHR_materials_volume"};

// What a material has and gpurt has not, as words for one warning.
class Losses {
 public:
  void add(const std::string &what) { text_ += text_.empty() ? what : ", " + what; }
  const std::string &text() const { return text_; }

 private:
  std::string text_;
};

Vec3f to_vec3(const std::vector<double> &v) { return {float(v[0]), float(v[1]), float(v[2])}; }

Vec3f attenuation_color(const tinygltf::Value &volume)
{
  Vec3f color{1, 1, 1};
  if (!volume.Has("attenuationColor")) return color;
  for (int c = 0; c < 3; ++c) set(color, c, float(volume.Get("attenuationColor").Get(c).GetNumberAsDouble()));
  return color;
}

// Sine and cosine of any angle, by reduction to [-pi/2, pi/2].
void sincos(double angle, double &s, double &c)
{
  const double turns = angle / (2 * pi_double);
  const double x = (turns - std::floor(turns + 0.5)) * 2 * pi_double;  // [-pi, pi]
  c = cosine(std::min(std::fabs(x), pi_double));
  const double folded = std::fabs(x) <= pi_double / 2 ? std::fabs(x) : pi_double - std::fabs(x);
  s = x < 0 ? -sine(folded) : sine(folded);
}

GltfTextureCoordinates coordinates_of(const tinygltf::TextureInfo &info)
{
  GltfTextureCoordinates result;
  result.is_used = true;
  result.set = info.texCoord;
  const tinygltf::Value *t = gltf_extension(info.extensions, "KHR_texture_transform");
  if (!t) return result;
  result.set = int(gltf_number(*t, "texCoord", info.texCoord));
  const auto pair = [t](const char *key, double value_if_absent, double(&out)[2]) {
    out[0] = out[1] = value_if_absent;
    if (!t->Has(key)) return;
    for (int i = 0; i < 2; ++i) out[i] = t->Get(key).Get(i).GetNumberAsDouble();
  };
  double offset[2], scale[2], s, c;
  pair("offset", 0, offset);
  pair("scale", 1, scale);
  sincos(gltf_number(*t, "rotation", 0), s, c);
  // Source: glTF extension KHR_texture_transform: translation * rotation * scale.
  const double m[6] = {c * scale[0], s * scale[1], offset[0], -s * scale[0], c * scale[1], offset[1]};
  std::copy(m, m + 6, result.transform);
  const double identity[6] = {1, 0, 0, 0, 1, 0};
  result.is_transformed = !std::equal(m, m + 6, identity);
  return result;
}

}  // namespace

const GltfLoadedMaterial &GltfMaterials::load(int index)
{
  const auto known = materials_.find(index);
  if (known != materials_.end()) return known->second;
  if (index < 0) {
    tinygltf::Material standard;
    standard.emissiveFactor = {0, 0, 0};
    return materials_[index] = convert(standard, "glTF's default material");
  }
  const tinygltf::Material &material = document_.model().materials[size_t(index)];
  return materials_[index] = convert(material, gltf_label("material", size_t(index), material.name));
}

GltfLoadedMaterial GltfMaterials::convert(const tinygltf::Material &material, const std::string &label)
{
  const tinygltf::PbrMetallicRoughness &pbr = material.pbrMetallicRoughness;
  MaterialSettings settings;
  GltfLoadedMaterial result;
  Losses losses;
  GltfImages::Mean mean;

  double metallic = pbr.metallicFactor, roughness = pbr.roughnessFactor;
  if (pbr.metallicRoughnessTexture.index >= 0) {
    const bool is_known = images_.mean_of_texture(pbr.metallicRoughnessTexture.index, false, mean);
    if (is_known) {
      roughness *= mean.rgba[1];
      metallic *= mean.rgba[2];
    }
    losses.add(is_known ? "metallic-roughness texture (its mean is used)" : "metallic-roughness texture");
  }
  double transmission = 0;
  if (const tinygltf::Value *e = gltf_extension(material.extensions, "KHR_materials_transmission")) {
    transmission = gltf_number(*e, "transmissionFactor", 0);
    if (e->Has("transmissionTexture")) losses.add("transmission texture");
  }

  settings.base_color = to_vec3(pbr.baseColorFactor);
  if (pbr.baseColorTexture.index >= 0) {
    settings.base_color_texture = images_.load_texture(pbr.baseColorTexture.index);
    if (settings.base_color_texture == invalid_id)
      losses.add("base-colour texture without a PNG or JPEG image");
    else result.coordinates = coordinates_of(pbr.baseColorTexture);
  }

  if (metallic >= 0.5) {
    settings.type = roughness < mirror_roughness ? MaterialType::Mirror : MaterialType::Metal;
    if (settings.type == MaterialType::Metal) settings.roughness = float(roughness);
    if (metallic < 1) losses.add(fmt::format("metallic {:.3g} (taken as 1)", metallic));
    if (roughness > 0 && roughness < mirror_roughness)
      losses.add(fmt::format("roughness {:.3g} (taken as 0)", roughness));
    if (transmission > 0 && metallic < 1)
      losses.add(fmt::format("transmission {:.3g} (taken as 0)", transmission));
  } else {
    if (metallic > 0) losses.add(fmt::format("metallic {:.3g} (taken as 0)", metallic));
    if (transmission >= 0.5) {
      settings.type = MaterialType::Glass;
      if (transmission < 1) losses.add(fmt::format("transmission {:.3g} (taken as 1)", transmission));
      if (roughness > 0) losses.add(fmt::format("roughness {:.3g} of glass (taken as 0)", roughness));
      if (const tinygltf::Value *e = gltf_extension(material.extensions, "KHR_materials_ior")) {
        const double ior = gltf_number(*e, "ior", 1.5);
        settings.ior = float(ior);
        if (ior == 0) losses.add("index of refraction 0, a perfect reflector (taken as 1.5)");
      }
      const tinygltf::Value *volume = gltf_extension(material.extensions, "KHR_materials_volume");
      const bool is_thin = !volume || gltf_number(*volume, "thicknessFactor", 0) == 0;
      if (is_thin) losses.add("thin walls (taken as a solid)");
      // glTF wants no absorption of thin walls, as there is no distance within them.
      if (!is_thin && volume->Has("attenuationDistance")) {
        settings.attenuation_distance = float(gltf_number(*volume, "attenuationDistance", 0));
        settings.attenuation_color = attenuation_color(*volume);
      }
      if (volume && volume->Has("thicknessTexture")) losses.add("thickness texture");
    } else {
      if (transmission > 0) losses.add(fmt::format("transmission {:.3g} (taken as 0)", transmission));
      const tinygltf::Value *e = gltf_extension(material.extensions, "KHR_materials_specular");
      if (!e || gltf_number(*e, "specularFactor", 1) > 0) losses.add("the specular layer of a dielectric");
    }
  }

  const tinygltf::Value *strength = gltf_extension(material.extensions, "KHR_materials_emissive_strength");
  const double scale = strength ? gltf_number(*strength, "emissiveStrength", 1) : 1;
  double emission[3];
  for (int c = 0; c < 3; ++c) emission[c] = material.emissiveFactor[size_t(c)] * scale;
  if (material.emissiveTexture.index >= 0 && emission[0] + emission[1] + emission[2] > 0) {
    // A mesh has one set of texture coordinates, which the base colour's texture comes first to.
    const GltfTextureCoordinates coordinates = coordinates_of(material.emissiveTexture);
    if (!result.coordinates.is_used || coordinates == result.coordinates) {
      settings.emission_texture = images_.load_texture(material.emissiveTexture.index);
      if (settings.emission_texture == invalid_id) losses.add("emissive texture without a PNG or JPEG image");
      else result.coordinates = coordinates;
    } else {
      const bool is_known = images_.mean_of_texture(material.emissiveTexture.index, true, mean);
      for (int c = 0; c < 3; ++c) emission[c] *= is_known ? mean.rgba[c] : 1;
      losses.add(is_known ? "emissive texture at other coordinates than the base colour's (its mean is used)"
                          : "emissive texture without a PNG or JPEG image");
    }
  }
  settings.emission = {float(emission[0]), float(emission[1]), float(emission[2])};
  settings.two_sided_emission = material.doubleSided;

  if (material.alphaMode == "MASK") {
    settings.alpha = float(pbr.baseColorFactor[3]);
    settings.alpha_cutoff = float(material.alphaCutoff);
  } else if (material.alphaMode == "BLEND") {
    settings.alpha = float(pbr.baseColorFactor[3]);
    settings.blends = true;
  }

  if (material.normalTexture.index >= 0) losses.add("normal map");
  if (material.occlusionTexture.index >= 0) losses.add("occlusion texture");
  for (const auto &[name, extension] : material.extensions) {
    if (!known_extensions.contains(name)) losses.add(printable(name));
  }
  if (!losses.text().empty())
    document_.warn("{} is approximated, without counterpart are: {}", label, losses.text());
  result.material = document_.checked(label, [&] { return add_material(scene_, settings); });
  return result;
}

}  // namespace gpurt
