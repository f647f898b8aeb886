// Embree 3 and 4 behind the same few calls.
#pragma once

#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

namespace gpurt::embree {

#if RTC_VERSION_MAJOR >= 4

constexpr RTCSceneFlags filter_in_query_flag = RTC_SCENE_FLAG_FILTER_FUNCTION_IN_ARGUMENTS;

inline void intersect(RTCScene scene, RTCRayHit &ray_hit) { rtcIntersect1(scene, &ray_hit, nullptr); }
inline void occluded(RTCScene scene, RTCRay &ray) { rtcOccluded1(scene, &ray, nullptr); }

/// A query whose filter sees every hit; `Query` derives from this.
struct FilteredQuery {
  RTCRayQueryContext context;
};

inline void intersect(RTCScene scene, RTCRayHit &ray_hit, FilteredQuery &query, RTCFilterFunctionN filter)
{
  rtcInitRayQueryContext(&query.context);
  RTCIntersectArguments arguments;
  rtcInitIntersectArguments(&arguments);
  arguments.flags = RTC_RAY_QUERY_FLAG_INVOKE_ARGUMENT_FILTER;
  arguments.context = &query.context;
  arguments.filter = filter;
  rtcIntersect1(scene, &ray_hit, &arguments);
}

#else

constexpr RTCSceneFlags filter_in_query_flag = RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION;

inline void intersect(RTCScene scene, RTCRayHit &ray_hit)
{
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(scene, &context, &ray_hit);
}

inline void occluded(RTCScene scene, RTCRay &ray)
{
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcOccluded1(scene, &context, &ray);
}

struct FilteredQuery {
  RTCIntersectContext context;
};

inline void intersect(RTCScene scene, RTCRayHit &ray_hit, FilteredQuery &query, RTCFilterFunctionN filter)
{
  rtcInitIntersectContext(&query.context);
  query.context.filter = filter;
  rtcIntersect1(scene, &query.context, &ray_hit);
}

#endif

}  // namespace gpurt::embree
