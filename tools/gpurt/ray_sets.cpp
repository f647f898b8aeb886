#include "ray_sets.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "options.h"
#include "rays.h"

namespace cli {

// Points and normals come from a frame of one sample.
std::vector<RaySet> make_ray_sets(gpurt_scene scene, const RaySetOptions &o)
{
  const gpurt_scene_facts facts = facts_of(scene);
  gpurt_camera_desc camera = GPURT_CAMERA_DESC_INIT;
  check(gpurt_scene_get_camera(scene, o.camera, &camera));
  const uint32_t width = o.width ? o.width : 1024;
  const uint32_t height = o.height ? o.height
                          : camera.width
                              ? std::max(1u, uint32_t(uint64_t(width) * camera.height / camera.width))
                              : width;
  std::vector<RaySet> sets;
  sets.push_back({"primary", GPURT_QUERY_CLOSEST, camera_rays(camera, width, height)});

  gpurt_frame_desc frame_desc = GPURT_FRAME_DESC_INIT;
  frame_desc.camera = o.camera;
  frame_desc.width = width;
  frame_desc.height = height;
  frame_desc.outputs = 1u << GPURT_OUTPUT_POSITION | 1u << GPURT_OUTPUT_NORMAL | 1u << GPURT_OUTPUT_PRIMITIVE;
  Frame frame;
  check(gpurt_frame_create(scene, &frame_desc, frame.out()));
  gpurt_render_desc render = GPURT_RENDER_DESC_INIT;
  render.samples_per_pixel = 1;
  render.max_depth = 1;
  Job job;
  check(gpurt_frame_submit(frame, &render, nullptr, 0, job.out()));
  check(gpurt_job_wait(job, GPURT_WAIT_FOREVER));
  const size_t num_pixels = size_t(width) * height;
  std::vector<Vec> positions(num_pixels), normals(num_pixels);
  std::vector<uint32_t> primitives(num_pixels);
  check(gpurt_frame_read(frame, GPURT_OUTPUT_POSITION, positions.data(), num_pixels * sizeof(Vec)));
  check(gpurt_frame_read(frame, GPURT_OUTPUT_NORMAL, normals.data(), num_pixels * sizeof(Vec)));
  check(gpurt_frame_read(frame, GPURT_OUTPUT_PRIMITIVE, primitives.data(), num_pixels * 4));

  Random random(1);
  const Vec lo{facts.bounds_min[0], facts.bounds_min[1], facts.bounds_min[2]},
      hi{facts.bounds_max[0], facts.bounds_max[1], facts.bounds_max[2]};
  const float diagonal = std::sqrt(dot(hi - lo, hi - lo));
  RaySet diffuse{"diffuse", GPURT_QUERY_CLOSEST, {}}, ambient{"ao", GPURT_QUERY_ANY, {}};
  for (size_t i = 0; i < num_pixels; ++i) {
    if (primitives[i] == GPURT_INVALID_ID || !(dot(normals[i], normals[i]) > 0)) continue;
    const Vec normal = normalize(normals[i]);
    // A start a little off the surface, so that it is not hit again; exactness is not the matter here.
    const Vec p = positions[i] + normal * (1e-4f * diagonal), d = cosine_direction(normal, random);
    diffuse.rays.push_back({{p.x, p.y, p.z}, 0, {d.x, d.y, d.z}, std::numeric_limits<float>::infinity()});
    const Vec e = cosine_direction(normal, random);
    ambient.rays.push_back({{p.x, p.y, p.z}, 0, {e.x, e.y, e.z}, 0.1f * diagonal});
  }
  sets.push_back(std::move(diffuse));
  sets.push_back(std::move(ambient));
  sets.push_back({"random", GPURT_QUERY_CLOSEST, random_rays(facts, num_pixels, random)});
  return sets;
}

}  // namespace cli
