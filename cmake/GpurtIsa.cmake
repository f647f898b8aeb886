# Instruction-set variants of the CPU backend's hot loops.
#
#   gpurt_isa_sources(<target> <file>...)
#   gpurt_wide_isa_sources(<target> <file>...)
#
# compiles each file once per variant, the second one for the wide variants alone, beside the first, with -DGPURT_ISA=<variant>; lib/core and these files put all they
# define into `inline namespace GPURT_ISA`, so the variants live side by side in one library and the backend
# picks one at run time. Everything else is compiled with the baseline's name.
#
# Files listed here hold kernels only: no standard library container or algorithm and no TBB, whose inline
# functions would be shared between variants, and the linker might keep the one that an old CPU cannot run.

set(gpurt_isa_variants "")
# Of kernels that gain by it: vectors of 512 bits.
set(gpurt_wide_isa_variants "")

# A variant is one line: its name, then the compiler flags beyond the baseline.
macro(gpurt_isa_variant name)
  list(APPEND gpurt_isa_variants ${name})
  set(gpurt_isa_flags_${name} ${ARGN})
endmacro()
macro(gpurt_wide_isa_variant name)
  list(APPEND gpurt_wide_isa_variants ${name})
  set(gpurt_isa_flags_${name} ${ARGN})
endmacro()

if(CMAKE_SYSTEM_PROCESSOR MATCHES "^(x86_64|AMD64)$")
  # Vectors wider than the registers: no function passes them, all are inlined.
  gpurt_isa_variant(x86_64 -Wno-psabi)
  gpurt_isa_variant(x86_64_v3 -march=x86-64-v3 -mtune=generic -Wno-psabi)
  # GCC takes undefined vectors of its own header for ours.
  gpurt_wide_isa_variant(x86_64_v4 -march=x86-64-v4 -mtune=generic -Wno-psabi -Wno-uninitialized -Wno-maybe-uninitialized)
else()
  gpurt_isa_variant(generic -Wno-psabi)
endif()

list(GET gpurt_isa_variants 0 gpurt_isa_baseline)
target_compile_definitions(gpurt_flags INTERFACE
  "GPURT_ISA=$<IF:$<BOOL:$<TARGET_PROPERTY:GPURT_ISA_NAME>>,$<TARGET_PROPERTY:GPURT_ISA_NAME>,${gpurt_isa_baseline}>")
# The dispatcher learns which variants exist: GPURT_HAVE_ISA_<variant>.
foreach(variant IN LISTS gpurt_isa_variants gpurt_wide_isa_variants)
  target_compile_definitions(gpurt_flags INTERFACE GPURT_HAVE_ISA_${variant}=1)
endforeach()

function(gpurt_isa_sources target)
  gpurt_sources_of_variants(${target} "${gpurt_isa_variants}" ${ARGN})
endfunction()

function(gpurt_wide_isa_sources target)
  gpurt_sources_of_variants(${target} "${gpurt_wide_isa_variants}" ${ARGN})
endfunction()

function(gpurt_sources_of_variants target variants)
  list(TRANSFORM ARGN PREPEND "${CMAKE_CURRENT_SOURCE_DIR}/" OUTPUT_VARIABLE sources)
  foreach(variant IN LISTS variants)
    set(objects ${target}_isa_${variant})
    if(NOT TARGET ${objects})
      add_library(${objects} OBJECT)
      set_target_properties(${objects} PROPERTIES GPURT_ISA_NAME ${variant})
      target_compile_options(${objects} PRIVATE ${gpurt_isa_flags_${variant}})
      target_include_directories(${objects} PRIVATE
        "${PROJECT_SOURCE_DIR}/lib" "$<TARGET_PROPERTY:${target},INCLUDE_DIRECTORIES>")
      target_link_libraries(${objects} PRIVATE gpurt_flags)
      target_sources(${target} PRIVATE $<TARGET_OBJECTS:${objects}>)
    endif()
    target_sources(${objects} PRIVATE ${sources})
  endforeach()
endfunction()
