# Warnings and code generation flags that every target of ours uses.
add_library(volalign_options INTERFACE)
target_compile_options(volalign_options INTERFACE
  -Wall -Wextra -Wshadow -Wnon-virtual-dtor -Woverloaded-virtual -Wno-unknown-pragmas
  # GCC 12 reports both inside Eigen's vectorised code, where they are wrong.
  -Wno-array-bounds -Wno-maybe-uninitialized)
if(VOLALIGN_NATIVE)
  target_compile_options(volalign_options INTERFACE -march=native)
  if(CMAKE_SYSTEM_PROCESSOR STREQUAL "x86_64")
    # AVX-512 gains nothing in our own loops and GCC 12's headers warn about it by the hundred.
    target_compile_options(volalign_options INTERFACE -mno-avx512f)
  endif()
endif()
# Debian's Ceres was compiled for plain x86-64: Eigen's alignment has to agree with it in every file.
target_compile_definitions(volalign_options INTERFACE EIGEN_MAX_ALIGN_BYTES=16)
# Same rounding whatever the processor's fused multiply-add (design section 4).
target_compile_options(volalign_options INTERFACE -ffp-contract=off)
if(VOLALIGN_ASAN)
  target_compile_options(volalign_options INTERFACE -fsanitize=address,undefined -fno-omit-frame-pointer)
  target_link_options(volalign_options INTERFACE -fsanitize=address,undefined)
endif()
target_include_directories(volalign_options INTERFACE "${PROJECT_SOURCE_DIR}")

# volalign_library(NAME SOURCES a.cc b.cc [DEPENDS t ...]): library volalign_NAME, alias volalign::NAME.
function(volalign_library name)
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPENDS;PRIVATE_DEPENDS" ${ARGN})
  add_library(volalign_${name} STATIC ${ARG_SOURCES})
  add_library(volalign::${name} ALIAS volalign_${name})
  target_link_libraries(volalign_${name} PUBLIC volalign_options ${ARG_DEPENDS} PRIVATE ${ARG_PRIVATE_DEPENDS})
endfunction()

# volalign_test(MODULE/FILE [SOURCES extra.cc] DEPENDS t ... [TIMEOUT s]): tests/MODULE/FILE_test.cc as the test MODULE/FILE.
function(volalign_test name)
  cmake_parse_arguments(ARG "" "TIMEOUT" "SOURCES;DEPENDS" ${ARGN})
  string(REPLACE "/" "_" target "${name}_test")
  get_filename_component(file "${name}" NAME)
  add_executable(${target} ${file}_test.cc ${ARG_SOURCES})
  target_link_libraries(${target} PRIVATE ${ARG_DEPENDS} volalign_test_main)
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 300)
  endif()
  add_test(NAME ${name} COMMAND ${target} WORKING_DIRECTORY "${PROJECT_SOURCE_DIR}")
  set_tests_properties(${name} PROPERTIES TIMEOUT ${ARG_TIMEOUT})
endfunction()
