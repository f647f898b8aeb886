#include "scene/scene_hash.h"

#define XXH_INLINE_ALL
#include <xxhash.h>

#include <memory>
#include <type_traits>

namespace gpurt {
namespace {

class Hash {
 public:
  Hash() : state_(XXH3_createState())
  {
    if (!state_) throw std::bad_alloc();
    XXH3_64bits_reset(state_.get());
  }
  void add_bytes(const void *data, uint64_t size)
  {
    add(size);  // so that neighbouring arrays cannot trade elements
    XXH3_64bits_update(state_.get(), data, size);
  }
  template <class T>
  void add(T value)
  {
    static_assert(std::is_arithmetic_v<T> || std::is_enum_v<T>);
    XXH3_64bits_update(state_.get(), &value, sizeof(value));
  }
  // Arrays of structures without padding: all their members are 4 bytes.
  template <class T>
  void add_array(const std::vector<T> &values)
  {
    static_assert(std::is_trivially_copyable_v<T> && alignof(T) == 4);
    add_bytes(values.data(), values.size() * sizeof(T));
  }
  uint64_t value() const { return XXH3_64bits_digest(state_.get()); }

 private:
  struct Free {
    void operator()(XXH3_state_t *state) const { XXH3_freeState(state); }
  };
  std::unique_ptr<XXH3_state_t, Free> state_;
};

}  // namespace

// Lights, their tree and the environment's table follow from the rest; but their construction may change from version
// to version, so they count too.
uint64_t hash_scene(const CompiledScene &scene)
{
  Hash hash;
  hash.add_array(scene.positions);
  hash.add_array(scene.indices);
  hash.add_array(scene.normals);
  hash.add_array(scene.uvs);
  hash.add_array(scene.segments);
  hash.add_array(scene.groups);
  hash.add_array(scene.group_geometry);
  hash.add_array(scene.placements);
  hash.add_array(scene.materials);
  for (const Texture &t : scene.textures) {
    hash.add(t.width);
    hash.add(t.height);
    hash.add(t.format);
    hash.add(t.wrap_u);
    hash.add(t.wrap_v);
    hash.add(t.nearest);
    hash.add_bytes(t.texels, uint64_t(t.width) * t.height * (t.format == TexelFormat::Rgba32f ? 16 : 4));
  }
  for (const Light &l : scene.lights) {
    hash.add(l.type);
    hash.add(l.triangle);
    hash.add(l.placement);
    hash.add(l.two_sided);
    for (Vec3f v : {l.color, l.position, l.direction}) {
      hash.add(v.x);
      hash.add(v.y);
      hash.add(v.z);
    }
    hash.add(l.cos_inner);
    hash.add(l.cos_outer);
    hash.add(l.tree_path);
  }
  hash.add_array(scene.light_bundles);
  hash.add(scene.environment.radiance.x);
  hash.add(scene.environment.radiance.y);
  hash.add(scene.environment.radiance.z);
  hash.add(scene.environment.texture);
  hash.add_array(scene.environment_rows);
  hash.add_array(scene.environment_columns);
  hash.add_array(scene.cameras);
  if (scene.num_patches != 0) {
    hash.add_array(scene.control_points);
    hash.add_array(scene.patch_ranges);
    hash.add_array(scene.patch_cells);
  }
  return hash.value();
}

}  // namespace gpurt
