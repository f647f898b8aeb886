# gpurt_flags: how everything that carries the library's arithmetic is compiled.
# The floating-point flags make CPU and CUDA give the same bits (docs: "Bits"); -ffast-math, -march=native
# and their kind never appear here.

add_library(gpurt_flags INTERFACE)
target_compile_features(gpurt_flags INTERFACE c_std_99 cxx_std_20)

set(gpurt_host_flags -ffp-contract=off -fno-math-errno -fno-trapping-math -Wall -Wextra)
target_compile_options(gpurt_flags INTERFACE "$<$<COMPILE_LANGUAGE:C,CXX>:${gpurt_host_flags}>")
target_compile_definitions(gpurt_flags INTERFACE $<$<CONFIG:Debug>:GPURT_ASSERTS>)

set(CMAKE_C_EXTENSIONS OFF)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_C_VISIBILITY_PRESET hidden)
set(CMAKE_CXX_VISIBILITY_PRESET hidden)
set(CMAKE_VISIBILITY_INLINES_HIDDEN ON)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)

if(GPURT_SANITIZE)
  if(GPURT_CUDA)
    message(FATAL_ERROR "GPURT_SANITIZE and GPURT_CUDA exclude each other")
  endif()
  add_compile_options(-fsanitize=${GPURT_SANITIZE} -fno-sanitize-recover=all -fno-omit-frame-pointer -g1)
  add_link_options(-fsanitize=${GPURT_SANITIZE})
endif()

find_package(Threads REQUIRED)
