# Install rules: library, headers, CMake package, pkg-config file; GPURT_BUNDLE adds the shared libraries.
include(CMakePackageConfigHelpers)

# The run path is always relative, so an installed tree can be moved. A bundled tree uses DT_RPATH, which
# (unlike DT_RUNPATH) also serves the libraries beside it: they need no editing.
set_target_properties(gpurt PROPERTIES INSTALL_RPATH "$ORIGIN")
if(GPURT_BUNDLE)
  target_link_options(gpurt PRIVATE -Wl,--disable-new-dtags)
endif()

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

if(GPURT_BUNDLE)
  configure_file("${CMAKE_CURRENT_LIST_DIR}/bundle.cmake.in" "${PROJECT_BINARY_DIR}/bundle.cmake.gen" @ONLY)
  file(GENERATE OUTPUT "${PROJECT_BINARY_DIR}/bundle-$<CONFIG>.cmake" INPUT "${PROJECT_BINARY_DIR}/bundle.cmake.gen")
  install(SCRIPT "${PROJECT_BINARY_DIR}/bundle-$<CONFIG>.cmake" COMPONENT runtime)
endif()
