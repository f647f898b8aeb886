// Where the library reads public structs in place, or casts enums: their layouts and values are those of its own types.
#include <cstddef>

#include "backend.h"
#include "gpurt.h"
#include "photon_maps.h"

namespace gpurt::api {
namespace {

static_assert(sizeof(Ray) == sizeof(gpurt_ray) && alignof(Ray) == alignof(gpurt_ray));
static_assert(offsetof(Ray, origin) == offsetof(gpurt_ray, origin));
static_assert(offsetof(Ray, tmin) == offsetof(gpurt_ray, tmin));
static_assert(offsetof(Ray, direction) == offsetof(gpurt_ray, direction));
static_assert(offsetof(Ray, tmax) == offsetof(gpurt_ray, tmax));

static_assert(sizeof(gpurt_hit) == 32 && sizeof(gpurt_hit_compact) == 16);

static_assert(sizeof(KdNode) == sizeof(gpurt_kdtree_node));
static_assert(offsetof(KdNode, word) == offsetof(gpurt_kdtree_node, word));
static_assert(offsetof(KdNode, tag) == offsetof(gpurt_kdtree_node, tag));

template <class A, class B>
constexpr bool same(A a, B b)
{
  return uint32_t(a) == uint32_t(b);
}

static_assert(same(Accel::Auto, GPURT_ACCEL_AUTO) && same(Accel::KdTree, GPURT_ACCEL_KDTREE));
static_assert(same(Accel::Embree, GPURT_ACCEL_EMBREE) && same(Accel::Bvh, GPURT_ACCEL_BVH));
static_assert(same(BuildQuality::Auto, GPURT_BUILD_QUALITY_AUTO) &&
              same(BuildQuality::Fast, GPURT_BUILD_QUALITY_FAST) &&
              same(BuildQuality::High, GPURT_BUILD_QUALITY_HIGH));
static_assert(same(TriangleTest::Watertight, GPURT_TRIANGLE_WATERTIGHT));
static_assert(same(TriangleTest::MollerTrumbore, GPURT_TRIANGLE_MOLLER_TRUMBORE));
static_assert(same(TriangleTest::Double, GPURT_TRIANGLE_DOUBLE));
static_assert(same(QueryKind::Closest, GPURT_QUERY_CLOSEST) && same(QueryKind::Any, GPURT_QUERY_ANY));
static_assert(same(QueryKind::All, GPURT_QUERY_ALL));
static_assert(same(MaterialType::Lambert, GPURT_MATERIAL_LAMBERT) &&
              same(MaterialType::Mirror, GPURT_MATERIAL_MIRROR));
static_assert(same(MaterialType::Glass, GPURT_MATERIAL_GLASS) &&
              same(MaterialType::Metal, GPURT_MATERIAL_METAL));
static_assert(same(TexelFormat::Rgba8Srgb, GPURT_TEXTURE_RGBA8_SRGB));
static_assert(same(TexelFormat::Rgba8Linear, GPURT_TEXTURE_RGBA8_LINEAR));
static_assert(same(TexelFormat::Rgba32f, GPURT_TEXTURE_RGBA32F));
static_assert(same(Wrap::Repeat, GPURT_WRAP_REPEAT) && same(Wrap::Clamp, GPURT_WRAP_CLAMP));
static_assert(same(Wrap::Mirror, GPURT_WRAP_MIRROR));
static_assert(same(invalid_id, GPURT_INVALID_ID));
static_assert(same(Traversal::Stack, GPURT_TRAVERSAL_STACK) &&
              same(Traversal::LeafLists, GPURT_TRAVERSAL_LEAF_LISTS));
static_assert(same(Traversal::Uber, GPURT_TRAVERSAL_UBER));
static_assert(same(Launch::Regular, GPURT_LAUNCH_REGULAR) &&
              same(Launch::Persistent, GPURT_LAUNCH_PERSISTENT) && same(Launch::Rounds, GPURT_LAUNCH_ROUNDS));
static_assert(same(Fetch::PerThread, GPURT_FETCH_PER_THREAD) && same(Fetch::Packets, GPURT_FETCH_PACKETS));
static_assert(same(Compaction::BlockScan, GPURT_COMPACTION_BLOCK_SCAN) &&
              same(Compaction::Pyramid, GPURT_COMPACTION_PYRAMID));
static_assert(same(Compaction::NaiveScan, GPURT_COMPACTION_NAIVE_SCAN) &&
              same(Compaction::LibraryScan, GPURT_COMPACTION_LIBRARY_SCAN));
static_assert(same(Shading::Immediate, GPURT_SHADING_IMMEDIATE) &&
              same(Shading::Sorted, GPURT_SHADING_SORTED));
static_assert(same(Generation::Slots, GPURT_GENERATION_SLOTS) &&
              same(Generation::Counted, GPURT_GENERATION_COUNTED) &&
              same(Generation::Refilled, GPURT_GENERATION_REFILLED));
static_assert(same(PhotonQueryKind::Count, GPURT_PHOTON_QUERY_COUNT) &&
              same(PhotonQueryKind::Sum, GPURT_PHOTON_QUERY_SUM));
static_assert(same(PhotonQueryKind::List, GPURT_PHOTON_QUERY_LIST) &&
              same(PhotonQueryKind::Nearest, GPURT_PHOTON_QUERY_NEAREST));
static_assert(same(GatherKernel::Constant, GPURT_GATHER_KERNEL_CONSTANT) &&
              same(GatherKernel::Cone, GPURT_GATHER_KERNEL_CONE) &&
              same(GatherKernel::Quadratic, GPURT_GATHER_KERNEL_QUADRATIC));
static_assert(sizeof(gpurt_photon_trace_desc) == 40 && sizeof(gpurt_photon_map_info) == 80);
static_assert(same(GatherMethod::Grid, GPURT_GATHER_GRID) &&
              same(GatherMethod::NodeLists, GPURT_GATHER_NODE_LISTS));
static_assert(sizeof(Vec3f) == 3 * sizeof(float));

}  // namespace
}  // namespace gpurt::api
