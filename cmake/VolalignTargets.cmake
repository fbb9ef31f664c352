include(GNUInstallDirs)

# Warnings and code generation flags that every target of ours uses, and none of a user's.
add_library(volalign_options INTERFACE)
target_compile_options(volalign_options INTERFACE
  -Wall -Wextra -Wshadow -Wnon-virtual-dtor -Woverloaded-virtual -Wno-unknown-pragmas
  # GCC 12 reports both inside Eigen's vectorised code, where they are wrong.
  -Wno-array-bounds $<$<CXX_COMPILER_ID:GNU>:-Wno-maybe-uninitialized>)
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_STANDARD GREATER_EQUAL 20)
  # GCC 12 reports this inside std::string's own functions in C++20, where it is wrong (GCC's bug 105651).
  target_compile_options(volalign_options INTERFACE -Wno-restrict)
endif()
if(CMAKE_SYSTEM_PROCESSOR STREQUAL "x86_64")
  # SSE4.2 and no AVX: with AVX, Eigen allocates 32-byte aligned blocks by a scheme of its own, and Debian's Ceres, which
  # shares Eigen's inline functions with us at run time, would free them with plain free().
  target_compile_options(volalign_options INTERFACE -march=x86-64-v2)
endif()
# Same rounding whatever the processor's fused multiply-add: a training sample is the same on every
# machine.
target_compile_options(volalign_options INTERFACE -ffp-contract=off)
if(UNIX AND NOT APPLE)
  # The C++ library before LibTorch: PyPI's libtorch.so exports parts of an older std::filesystem, which programs would use otherwise, and crash.
  target_link_options(volalign_options INTERFACE "LINKER:--push-state,--no-as-needed" -lstdc++ "LINKER:--pop-state")
endif()
include(CheckLinkerFlag)
check_linker_flag(CXX -fuse-ld=gold VOLALIGN_HAS_GOLD)
if(VOLALIGN_HAS_GOLD AND NOT VOLALIGN_ASAN)
  # Links the program in 0.6 s of processor time, where the default linker takes 3.5 s. It warns of a hundred symbols of clang's address sanitizer.
  target_link_options(volalign_options INTERFACE -fuse-ld=gold)
endif()
foreach(folder ${VOLALIGN_TORCH_LIBRARY_FOLDERS})
  target_link_options(volalign_options INTERFACE "LINKER:-rpath-link,${folder}")
endforeach()
if(VOLALIGN_ASAN)
  # Undefined behaviour is an illegal instruction, at which AddressSanitizer says where it stands (ASAN_OPTIONS=handle_sigill=1): of the checks of a
  # loop over Eigen's vectors, compiled by clang 14, those that report by themselves take twice the time.
  target_compile_options(volalign_options INTERFACE
    -fsanitize=address,undefined -fsanitize-trap=undefined -fno-omit-frame-pointer)
  target_link_options(volalign_options INTERFACE -fsanitize=address,undefined)
endif()
if(VOLALIGN_FUZZ)
  target_compile_options(volalign_options INTERFACE -fsanitize=fuzzer-no-link)
endif()
target_include_directories(volalign_options INTERFACE "${PROJECT_SOURCE_DIR}" ${VOLALIGN_FIRST_INCLUDES})

# volalign_kernels(VARIABLE FILE.inc [OPTIONS o ...] [SETS "name lanes option ..." ...]): sources that compile a file of kernels once for each instruction set,
# under a namespace of its own (VOLALIGN_SET, with VOLALIGN_LANES numbers in a vector); the program takes what the processor has (core/base/kernel_sets.h).
# SETS are more of them, of x86-64.
function(volalign_kernels variable file)
  cmake_parse_arguments(ARG "" "" "OPTIONS;SETS" ${ARGN})
  set(sets "baseline 4")
  if(CMAKE_SYSTEM_PROCESSOR STREQUAL "x86_64")
    list(APPEND sets "avx2 8 -march=x86-64-v3" "avx512 16 -march=x86-64-v4" ${ARG_SETS})
  endif()
  file(RELATIVE_PATH path "${PROJECT_SOURCE_DIR}" "${CMAKE_CURRENT_SOURCE_DIR}/${file}")
  foreach(entry IN LISTS sets)
    separate_arguments(words UNIX_COMMAND "${entry}")
    list(POP_FRONT words set lanes)
    string(REPLACE ".inc" "_${set}.cc" source "${CMAKE_CURRENT_BINARY_DIR}/${file}")
    file(CONFIGURE OUTPUT "${source}" CONTENT "#define VOLALIGN_SET ${set}\n#define VOLALIGN_LANES ${lanes}\n#include \"${path}\"\n")
    # Loops become vector instructions only where no square root sets errno and no comparison may trap. Vectors wider than the instruction set's are passed
    # between functions of one file only.
    set_source_files_properties("${source}" PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON
      COMPILE_OPTIONS "-O3;-fno-math-errno;-fno-trapping-math;-Wno-psabi;${ARG_OPTIONS};${words}")
    list(APPEND sources "${source}")
  endforeach()
  set(${variable} ${sources} PARENT_SCOPE)
endfunction()

# volalign_library(MODULE [COMPONENT c] [FOLDERS f ...] [EXCEPT a ...] [SOURCES b.cc ...] [PUBLIC_HEADERS a.h] [DEPENDS t ...] [PRIVATE_DEPENDS t ...]):
# the module core/geometry is the library volalign_core_geometry, alias volalign::core_geometry. It has all .cc of its folder, and of FOLDERS in it, but
# for those named in EXCEPT (a: a.cc), and SOURCES that the build makes. DEPENDS are of its headers, PRIVATE_DEPENDS of its sources alone; the test
# `layout` compares both with what the module includes. Our flags are no user's: volalign_options is private. With COMPONENT it is installed, with
# its PUBLIC_HEADERS (VolalignInstall.cmake).
function(volalign_library module)
  cmake_parse_arguments(ARG "" "COMPONENT" "FOLDERS;EXCEPT;SOURCES;PUBLIC_HEADERS;DEPENDS;PRIVATE_DEPENDS" ${ARGN})
  string(REPLACE "/" "_" name "${module}")
  list(TRANSFORM ARG_FOLDERS APPEND "/*.cc")
  file(GLOB sources CONFIGURE_DEPENDS "*.cc" ${ARG_FOLDERS})
  foreach(file ${ARG_EXCEPT})
    list(REMOVE_ITEM sources "${CMAKE_CURRENT_SOURCE_DIR}/${file}.cc")
  endforeach()
  add_library(volalign_${name} STATIC ${sources} ${ARG_SOURCES})
  add_library(volalign::${name} ALIAS volalign_${name})
  target_link_libraries(volalign_${name} PUBLIC ${ARG_DEPENDS} PRIVATE ${ARG_PRIVATE_DEPENDS} $<BUILD_INTERFACE:volalign_options>)
  volalign_needs_torch(needs_torch ${ARG_DEPENDS} ${ARG_PRIVATE_DEPENDS})
  set_target_properties(volalign_${name} PROPERTIES VOLALIGN_NEEDS_TORCH ${needs_torch} EXPORT_NAME ${name})
  if(ARG_COMPONENT)
    list(TRANSFORM ARG_PUBLIC_HEADERS PREPEND "${CMAKE_CURRENT_SOURCE_DIR}/" OUTPUT_VARIABLE headers)
    set_property(GLOBAL APPEND PROPERTY VOLALIGN_PUBLIC_HEADERS ${headers})
    target_sources(volalign_${name} PUBLIC FILE_SET HEADERS BASE_DIRS "${PROJECT_SOURCE_DIR}" FILES ${ARG_PUBLIC_HEADERS})
    install(TARGETS volalign_${name} EXPORT volalign_${ARG_COMPONENT}
      ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT ${ARG_COMPONENT}
      FILE_SET HEADERS DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/volalign COMPONENT ${ARG_COMPONENT})
  endif()
endfunction()

# Whether one of these targets is LibTorch, or a module that stands on it.
function(volalign_needs_torch result)
  set(${result} OFF PARENT_SCOPE)
  foreach(target ${ARGN})
    if(TARGET ${target})
      get_target_property(needs_torch ${target} VOLALIGN_NEEDS_TORCH)
      if(target STREQUAL "torch" OR needs_torch)
        set(${result} ON PARENT_SCOPE)
      endif()
    endif()
  endforeach()
endfunction()

# Programs with assertions, sanitizers or counts of lines take ten times as long.
function(volalign_time_limit seconds variable)
  if(NOT CMAKE_BUILD_TYPE STREQUAL "Release")
    math(EXPR seconds "10 * ${seconds}")
  endif()
  set(${variable} ${seconds} PARENT_SCOPE)
endfunction()

# volalign_script_test(NAME SECONDS [LABELS l ...] COMMAND SCRIPT ARGUMENT ...): a test by a Python script. Its label is `slow`, or those of LABELS
# (see volalign_tests).
function(volalign_script_test name seconds)
  cmake_parse_arguments(ARG "" "" "LABELS;COMMAND" ${ARGN})
  if(NOT "long" IN_LIST ARG_LABELS)
    list(PREPEND ARG_LABELS slow)
  endif()
  add_test(NAME ${name} COMMAND Python3::Interpreter ${ARG_COMMAND})
  volalign_time_limit(${seconds} timeout)
  set_tests_properties(${name} PROPERTIES TIMEOUT ${timeout} COST ${seconds} LABELS "${ARG_LABELS}"
    ENVIRONMENT "LP_NUM_THREADS=0;PYTHONDONTWRITEBYTECODE=1")
endfunction()

# volalign_tests(MODULE [SLOW] DEPENDS t ... [TIMEOUT s] TESTS a b ... [NEEDS a:PART:l ...]): tests/MODULE/a_test.cc and the others as one program, MODULE_tests, and each file as
# the test MODULE/a, a process of its own.
# Their label is `quick`, or `slow` with SLOW, which are the program MODULE_slow_tests: several minutes under the sanitizers, or in need of more than
# their own folder and those below. NEEDS takes the tests of a_test.cc whose names have PART out of it, as the test MODULE/a.PART with the further
# label needs-l: tests/missing.sh says which of these labels a machine cannot run. A label is one of quick, slow and long besides.
# The target quick_tests_FOLDER builds the quick tests of a folder and those
# below it, with _ for /.
function(volalign_tests module)
  cmake_parse_arguments(ARG "SLOW" "TIMEOUT" "DEPENDS;TESTS;NEEDS" ${ARGN})
  set(label quick)
  string(REPLACE "/" "_" target "${module}_tests")
  if(ARG_SLOW)
    set(label slow)
    string(REPLACE "/" "_" target "${module}_slow_tests")
  endif()
  list(TRANSFORM ARG_TESTS REPLACE "(.+)" "${PROJECT_SOURCE_DIR}/tests/${module}/\\1_test.cc" OUTPUT_VARIABLE sources)
  add_executable(${target} ${sources})
  set_target_properties(${target} PROPERTIES RUNTIME_OUTPUT_DIRECTORY "${PROJECT_BINARY_DIR}/tests/${module}")
  # Tests' own code compiles in half the time so, and little of the work is its.
  target_compile_options(${target} PRIVATE $<$<CONFIG:Release>:-O1>)
  volalign_needs_torch(needs_torch ${ARG_DEPENDS})
  target_link_libraries(${target} PRIVATE ${ARG_DEPENDS} volalign_options
    $<IF:$<BOOL:${needs_torch}>,volalign_torch_test_main,volalign_test_main>)
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 300)
  endif()
  # What may take longest starts first, so that no job is left alone with it.
  set(cost 0)
  if(ARG_SLOW)
    set(cost ${ARG_TIMEOUT})
  endif()
  volalign_time_limit(${ARG_TIMEOUT} timeout)
  set(names)
  foreach(test IN LISTS ARG_TESTS)
    set(command ${target} "tests/${module}/${test}_test.cc")
    set(others)
    foreach(need IN LISTS ARG_NEEDS)
      string(REPLACE ":" ";" labels "${need}")
      list(POP_FRONT labels file part)
      if(file STREQUAL test)
        list(TRANSFORM labels PREPEND needs-)
        add_test(NAME ${module}/${test}.${part} COMMAND ${command} ${part} WORKING_DIRECTORY "${PROJECT_SOURCE_DIR}")
        set_tests_properties(${module}/${test}.${part} PROPERTIES LABELS "${labels}")
        list(APPEND names ${module}/${test}.${part})
        list(APPEND others -${part})
      endif()
    endforeach()
    add_test(NAME ${module}/${test} COMMAND ${command} ${others} WORKING_DIRECTORY "${PROJECT_SOURCE_DIR}")
    list(APPEND names ${module}/${test})
  endforeach()
  # LP_NUM_THREADS: see KeepSoftwareRenderingOnOneThread in render/egl/egl_context.h.
  set_tests_properties(${names} PROPERTIES TIMEOUT ${timeout} COST ${cost} ENVIRONMENT "LP_NUM_THREADS=0")
  set_property(TEST ${names} APPEND PROPERTY LABELS ${label})
  if(NOT ARG_SLOW)
    set(folder ${module})
    while(folder)
      string(REPLACE "/" "_" quick "quick_tests_${folder}")
      if(NOT TARGET ${quick})
        add_custom_target(${quick})
      endif()
      add_dependencies(${quick} ${target})
      cmake_path(GET folder PARENT_PATH folder)
    endwhile()
  endif()
endfunction()
