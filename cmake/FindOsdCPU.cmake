# OpenSubdiv's CPU library as osdCPU::osdCPU. Its own package configuration cannot be used: Debian's and Ubuntu's
# name static and GPU libraries that their packages do not carry.
find_path(OsdCPU_INCLUDE_DIR opensubdiv/far/topologyRefiner.h)
find_library(OsdCPU_LIBRARY osdCPU)
mark_as_advanced(OsdCPU_INCLUDE_DIR OsdCPU_LIBRARY)

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(OsdCPU REQUIRED_VARS OsdCPU_LIBRARY OsdCPU_INCLUDE_DIR)

if(OsdCPU_FOUND AND NOT TARGET osdCPU::osdCPU)
  add_library(osdCPU::osdCPU UNKNOWN IMPORTED)
  set_target_properties(osdCPU::osdCPU PROPERTIES
    IMPORTED_LOCATION "${OsdCPU_LIBRARY}" INTERFACE_INCLUDE_DIRECTORIES "${OsdCPU_INCLUDE_DIR}")
endif()
