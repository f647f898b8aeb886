# Install rules. Included once the target gpurt exists; gpurt_install_bundle() comes after the last program.
#
# Components: runtime (library, licences), devel (headers, CMake package, pkg-config file), tools (programs), and
# gpu (tests and benchmarks for a GPU machine; only when asked for by name, see scripts/gpu). GPURT_BUNDLE=ON
# adds to runtime, tools and gpu the non-system shared libraries that they need.
include(CMakePackageConfigHelpers)

# Run paths are relative, so that an installed tree can be moved. A bundled tree has DT_RPATH, which (unlike
# DT_RUNPATH) also serves the libraries beside the library: they need no editing.
if(GPURT_BUNDLE)
  target_link_options(gpurt PRIVATE -Wl,--disable-new-dtags)
endif()
set_target_properties(gpurt PROPERTIES INSTALL_RPATH "$ORIGIN")

install(TARGETS gpurt EXPORT gpurt-targets
  LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT runtime NAMELINK_COMPONENT devel)
install(DIRECTORY "${PROJECT_SOURCE_DIR}/include/" DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT devel
  FILES_MATCHING PATTERN "gpurt*.h" PATTERN "gpurt*.hpp")
install(FILES "${PROJECT_SOURCE_DIR}/LICENSE" "${PROJECT_SOURCE_DIR}/THIRD_PARTY_NOTICES.md"
  DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT runtime)

set(gpurt_cmake_dir ${CMAKE_INSTALL_LIBDIR}/cmake/gpurt)
install(EXPORT gpurt-targets NAMESPACE gpurt:: DESTINATION ${gpurt_cmake_dir} COMPONENT devel)
configure_package_config_file("${CMAKE_CURRENT_LIST_DIR}/gpurt-config.cmake.in"
  "${PROJECT_BINARY_DIR}/gpurt-config.cmake" INSTALL_DESTINATION ${gpurt_cmake_dir}
  NO_SET_AND_CHECK_MACRO NO_CHECK_REQUIRED_COMPONENTS_MACRO)
write_basic_package_version_file("${PROJECT_BINARY_DIR}/gpurt-config-version.cmake"
  COMPATIBILITY SameMinorVersion)
install(FILES "${PROJECT_BINARY_DIR}/gpurt-config.cmake" "${PROJECT_BINARY_DIR}/gpurt-config-version.cmake"
  DESTINATION ${gpurt_cmake_dir} COMPONENT devel)

# The prefix of gpurt.pc is found from where the file lies.
set(gpurt_pc_dir ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
file(RELATIVE_PATH gpurt_pc_prefix "/prefix/${gpurt_pc_dir}" "/prefix")
configure_file("${CMAKE_CURRENT_LIST_DIR}/gpurt.pc.in" "${PROJECT_BINARY_DIR}/gpurt.pc" @ONLY)
install(FILES "${PROJECT_BINARY_DIR}/gpurt.pc" DESTINATION ${gpurt_pc_dir} COMPONENT devel)

# gpurt_install_program(<target> <destination> <component>)
function(gpurt_install_program target destination component)
  file(RELATIVE_PATH to_lib "/prefix/${destination}" "/prefix/${CMAKE_INSTALL_LIBDIR}")
  set_target_properties(${target} PROPERTIES INSTALL_RPATH "$ORIGIN/${to_lib}")
  if(GPURT_BUNDLE)
    target_link_options(${target} PRIVATE -Wl,--disable-new-dtags)
  endif()
  set(unless_named "")
  if(component STREQUAL gpu)
    set(unless_named EXCLUDE_FROM_ALL)
  endif()
  install(TARGETS ${target} RUNTIME DESTINATION ${destination} COMPONENT ${component} ${unless_named})
  set_property(GLOBAL APPEND PROPERTY GPURT_PROGRAMS_${component} ${target})
endfunction()

# Adds the libraries of one component, where it has programs.
function(gpurt_install_bundle)
  if(NOT GPURT_BUNDLE)
    return()
  endif()
  foreach(component runtime tools gpu)
    set(files_kind EXECUTABLES)
    get_property(targets GLOBAL PROPERTY GPURT_PROGRAMS_${component})
    if(component STREQUAL runtime)
      set(files_kind LIBRARIES)
      set(targets gpurt)
    endif()
    if(NOT targets)
      continue()
    endif()
    list(TRANSFORM targets REPLACE "(.+)" "\"$<TARGET_FILE:\\1>\"")
    list(JOIN targets " " files)
    configure_file("${PROJECT_SOURCE_DIR}/cmake/bundle.cmake.in"
      "${PROJECT_BINARY_DIR}/bundle-${component}.in" @ONLY)
    file(GENERATE OUTPUT "${PROJECT_BINARY_DIR}/bundle-${component}-$<CONFIG>.cmake"
      INPUT "${PROJECT_BINARY_DIR}/bundle-${component}.in")
    set(unless_named "")
    if(component STREQUAL gpu)
      set(unless_named EXCLUDE_FROM_ALL)
    endif()
    install(SCRIPT "${PROJECT_BINARY_DIR}/bundle-${component}-$<CONFIG>.cmake"
      COMPONENT ${component} ${unless_named})
  endforeach()
endfunction()
