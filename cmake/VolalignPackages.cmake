# Debian packages of what is installed: `cpack --config build/release/CPackConfig.cmake -B FOLDER` (packaging/deb.sh). With SOURCE_DATE_EPOCH, the
# same files give the same packages.
#
#   volalign          the program, with configs, models and documents
#   libvolalign-c0    libvolalign_c.so.0, for C and for what calls C
#   libvolalign-dev   the C++ libraries, their headers and CMake files, and those of libvolalign_c
#   python3-volalign  the Python package
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME volalign)
set(CPACK_PACKAGE_CONTACT "the volalign project")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "${PROJECT_DESCRIPTION}")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_PRE_BUILD_SCRIPTS "${PROJECT_SOURCE_DIR}/packaging/arrange.cmake")
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_GROUPING ONE_PER_GROUP)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)

# volalign_package(GROUP NAME SECTION COMPONENTS ... [SHLIBS] [DEPENDS ...] [RECOMMENDS ...] [DESCRIPTION text]): of these components, those that are installed.
macro(volalign_package group name section)
  cmake_parse_arguments(ARG "SHLIBS" "DESCRIPTION" "COMPONENTS;DEPENDS;RECOMMENDS" ${ARGN})
  string(TOUPPER ${group} _key)
  list(JOIN ARG_DEPENDS ", " CPACK_DEBIAN_${_key}_PACKAGE_DEPENDS)
  list(JOIN ARG_RECOMMENDS ", " CPACK_DEBIAN_${_key}_PACKAGE_RECOMMENDS)
  set(CPACK_DEBIAN_${_key}_PACKAGE_NAME ${name})
  set(CPACK_DEBIAN_${_key}_PACKAGE_SECTION ${section})
  set(CPACK_DEBIAN_${_key}_PACKAGE_SHLIBDEPS ${ARG_SHLIBS})
  set(CPACK_DEBIAN_${_key}_DESCRIPTION "${ARG_DESCRIPTION}")
  foreach(_component IN LISTS ARG_COMPONENTS)
    set(CPACK_COMPONENT_${_component}_GROUP ${group})
    string(TOUPPER ${_component} _component_key)
    set(CPACK_COMPONENT_${_component_key}_GROUP ${group})
    list(APPEND CPACK_COMPONENTS_ALL ${_component})
  endforeach()
endmacro()
set(CPACK_COMPONENTS_ALL "")
if(VOLALIGN_WITH_TORCH)
  volalign_package(program volalign science SHLIBS COMPONENTS program DEPENDS "" RECOMMENDS libegl1 libgl1-mesa-dri
    DESCRIPTION "Places depth sensors around a capture volume from one still depth frame each of a stack of plain boxes: renders labelled depth images, trains networks on them, and calibrates rigs.")
endif()
if(VOLALIGN_WITH_INFER)
  volalign_package(c libvolalign-c0 libs SHLIBS COMPONENTS c
    DESCRIPTION "Calibration of depth sensors as a shared library for C, without LibTorch.")
endif()
if(VOLALIGN_WITH_PYTHON)
  volalign_package(python python3-volalign python SHLIBS COMPONENTS python DEPENDS python3 python3-numpy
    DESCRIPTION "Calibration of depth sensors and rendered training samples as a Python package, without LibTorch.")
endif()
get_property(_components GLOBAL PROPERTY VOLALIGN_COMPONENTS)
set(_libraries libassimp-dev libeigen3-dev libembree-dev libfmt-dev libnanoflann-dev libssl-dev libyaml-cpp-dev nlohmann-json3-dev libpng-dev libtinygltf-dev libegl-dev libepoxy-dev)
if(VOLALIGN_WITH_INFER)
  list(APPEND _libraries libceres-dev libopencv-dev libtiff-dev libopenexr-dev libavformat-dev libbz2-dev zlib1g-dev liblz4-dev libzstd-dev libsqlite3-dev libonnx-dev libprotobuf-dev libvolalign-c0)
endif()
set(_recommended "")
if(VOLALIGN_WITH_TORCH)
  set(_recommended libtorch-dev libgloo-dev libopenblas0-pthread libcli11-dev)
endif()
volalign_package(dev libvolalign-dev libdevel COMPONENTS ${_components} DEPENDS ${_libraries} RECOMMENDS ${_recommended}
  DESCRIPTION "Headers, libraries and CMake files for programs in C++ and C. The components nn, segmentation and train need LibTorch.")
include(CPack)
