# Finds a CUDA 12 or newer compiler and enables the language: a system toolkit first, else the toolkit that
# scripts/setup put into a Python virtual environment from NVIDIA's wheels. Sets how .cu files are compiled.

function(gpurt_find_nvcc out)
  find_program(nvcc_system nvcc PATHS "$ENV{CUDA_PATH}/bin" "$ENV{CUDA_HOME}/bin" /usr/local/cuda/bin NO_CACHE)
  file(GLOB nvcc_wheel
    "$ENV{VIRTUAL_ENV}/lib/python3.*/site-packages/nvidia/cu13/bin/nvcc"
    "${PROJECT_SOURCE_DIR}/.venv/lib/python3.*/site-packages/nvidia/cu13/bin/nvcc")
  foreach(nvcc IN LISTS nvcc_system nvcc_wheel)
    execute_process(COMMAND "${nvcc}" --version OUTPUT_VARIABLE version ERROR_QUIET)
    if(version MATCHES "release ([0-9.]+)" AND CMAKE_MATCH_1 VERSION_GREATER_EQUAL 12)
      set(${out} "${nvcc}" PARENT_SCOPE)
      return()
    endif()
  endforeach()
  message(FATAL_ERROR "GPURT_CUDA=ON needs nvcc 12 or newer, on the PATH or in .venv (scripts/setup --cuda)")
endfunction()

if(NOT CMAKE_CUDA_COMPILER)
  gpurt_find_nvcc(nvcc)
  set(CMAKE_CUDA_COMPILER "${nvcc}" CACHE FILEPATH "CUDA compiler")
endif()
if(NOT CMAKE_CUDA_ARCHITECTURES)
  set(CMAKE_CUDA_ARCHITECTURES 90 CACHE STRING "CUDA architectures to compile for")
endif()
# Static, so that the library loads where there is neither driver nor CUDA library.
set(CMAKE_CUDA_RUNTIME_LIBRARY Static)
set(CMAKE_CUDA_VISIBILITY_PRESET hidden)
set(CMAKE_CUDA_EXTENSIONS OFF)
enable_language(CUDA)

list(JOIN gpurt_host_flags "," gpurt_cuda_host_flags)
set(gpurt_cuda_flags --fmad=false -ftz=false -prec-div=true -prec-sqrt=true --expt-relaxed-constexpr
  -Xcompiler=${gpurt_cuda_host_flags})
target_compile_options(gpurt_flags INTERFACE "$<$<COMPILE_LANGUAGE:CUDA>:${gpurt_cuda_flags}>")
target_compile_features(gpurt_flags INTERFACE cuda_std_20)
