// gpurt_scene_locate: check the request, find the patches of hits.
#include "api/descriptor.h"
#include "api/guard.h"
#include "api/memory_range.h"
#include "api/objects.h"
#include "scene/patch_hits.h"

namespace gpurt::api {
namespace {

LocateRequest checked_request(const gpurt_locate_desc &d)
{
  check_enum(d.format, GPURT_HIT_COMPACT + 1, "format", "gpurt_hit_format");
  LocateRequest r;
  r.compact = d.format == GPURT_HIT_COMPACT;
  if (!r.compact) {
    const auto refuse = [](const char *field, uint32_t value) {
      if (value != 0)
        fail_invalid("{} is {}, but hits of GPURT_HIT_FULL say theirs; set it to 0", field, value);
    };
    refuse("geometry", d.geometry);
    refuse("instance", d.instance);
  }
  r.num_hits = d.num_hits;
  r.hits = d.hits;
  r.geometry = d.geometry;
  r.instance = d.instance;
  r.points = d.points;
  r.positions = d.positions;
  r.normals = d.normals;

  const uint64_t hit_bytes = r.compact ? sizeof(gpurt_hit_compact) : sizeof(gpurt_hit);
  const auto vectors = [&](const char *name, const float *data) {
    return checked_range(name, data, data ? d.num_hits : 0, 3 * sizeof(float), alignof(float));
  };
  const Range ranges[] = {
      checked_range("hits", d.hits, d.num_hits, hit_bytes, alignof(gpurt_hit)),
      checked_range("points", d.points, d.num_hits, sizeof(gpurt_patch_point), alignof(gpurt_patch_point)),
      vectors("positions", d.positions), vectors("normals", d.normals)};
  for (size_t i = 0; i < std::size(ranges); ++i) {
    for (size_t j = 0; j < i; ++j) check_disjoint(ranges[j], ranges[i]);
  }
  return r;
}

}  // namespace
}  // namespace gpurt::api

using namespace gpurt;
using namespace gpurt::api;

gpurt_result gpurt_scene_locate(gpurt_scene scene, const gpurt_locate_desc *desc)
{
  return guard([&] {
    const auto s = get(scene, "scene");
    const gpurt_locate_desc d = read_descriptor(desc);
    const LocateRequest request = checked_request(d);
    locate_on_patches(*s->require_commit()->compiled, request);
  });
}
