/* Uses every INIT macro; compiled as C and C++ under every standard with all warnings as errors. */
#include "gpurt_cuda.h"

#ifdef __cplusplus
extern "C"
#endif
    int
    gpurt_test_init_macros(void);

int gpurt_test_init_macros(void)
{
  gpurt_device_desc device = GPURT_DEVICE_DESC_INIT;
  gpurt_device_properties properties = GPURT_DEVICE_PROPERTIES_INIT;
  gpurt_buffer_desc buffer = GPURT_BUFFER_DESC_INIT;
  gpurt_texture_desc texture = GPURT_TEXTURE_DESC_INIT;
  gpurt_material_desc material = GPURT_MATERIAL_DESC_INIT;
  gpurt_mesh_desc mesh = GPURT_MESH_DESC_INIT;
  gpurt_patches_desc patches = GPURT_PATCHES_DESC_INIT;
  gpurt_subdivision_desc subdivision = GPURT_SUBDIVISION_DESC_INIT;
  gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
  gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
  gpurt_environment_desc environment = GPURT_ENVIRONMENT_DESC_INIT;
  gpurt_camera_desc camera = GPURT_CAMERA_DESC_INIT;
  gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
  gpurt_scene_facts facts = GPURT_SCENE_FACTS_INIT;
  gpurt_kdtree tree = GPURT_KDTREE_INIT;
  gpurt_trace_desc trace = GPURT_TRACE_DESC_INIT;
  gpurt_locate_desc locate = GPURT_LOCATE_DESC_INIT;
  gpurt_frame_desc frame = GPURT_FRAME_DESC_INIT;
  gpurt_render_desc render = GPURT_RENDER_DESC_INIT;
  gpurt_statistics statistics = GPURT_STATISTICS_INIT;
  gpurt_photon_map_desc map = GPURT_PHOTON_MAP_DESC_INIT;
  gpurt_photon_map_info map_info = GPURT_PHOTON_MAP_INFO_INIT;
  gpurt_photon_query_desc photons = GPURT_PHOTON_QUERY_DESC_INIT;
  gpurt_photon_trace_desc photon_trace = GPURT_PHOTON_TRACE_DESC_INIT;
  return device.struct_size == sizeof device && properties.struct_size == sizeof properties &&
         buffer.struct_size == sizeof buffer && texture.struct_size == sizeof texture &&
         material.struct_size == sizeof material && mesh.struct_size == sizeof mesh &&
         patches.struct_size == sizeof patches && subdivision.struct_size == sizeof subdivision &&
         instance.struct_size == sizeof instance && light.struct_size == sizeof light &&
         environment.struct_size == sizeof environment && camera.struct_size == sizeof camera &&
         build.struct_size == sizeof build && facts.struct_size == sizeof facts &&
         tree.struct_size == sizeof tree && trace.struct_size == sizeof trace &&
         locate.struct_size == sizeof locate && frame.struct_size == sizeof frame &&
         render.struct_size == sizeof render && statistics.struct_size == sizeof statistics &&
         map.struct_size == sizeof map && map_info.struct_size == sizeof map_info &&
         photons.struct_size == sizeof photons && photon_trace.struct_size == sizeof photon_trace;
}
