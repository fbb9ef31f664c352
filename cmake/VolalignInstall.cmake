# What `cmake --install` gives a C++ program: find_package(volalign COMPONENTS calibration), target volalign::calibration.
#
# A component is a group of modules (COMPONENT of volalign_library), each of which is a target as in this build, and one target that stands for
# them, which `render`, `train` and `cli` have as a module already. `core`, `core_formats` and `core_model` are what the others stand on.
include(CMakePackageConfigHelpers)
set(VOLALIGN_PACKAGE_FOLDER "${CMAKE_INSTALL_LIBDIR}/cmake/volalign")

# volalign_component(NAME [MODULES volalign_x ...]): target volalign::NAME of these modules and what comes with them.
function(volalign_component component)
  set_property(GLOBAL APPEND PROPERTY VOLALIGN_COMPONENTS ${component})
  cmake_parse_arguments(ARG "" "" "MODULES" ${ARGN})
  if(ARG_MODULES)
    add_library(volalign_${component}_component INTERFACE)
    add_library(volalign::${component} ALIAS volalign_${component}_component)
    set_target_properties(volalign_${component}_component PROPERTIES EXPORT_NAME ${component})
    target_link_libraries(volalign_${component}_component INTERFACE ${ARG_MODULES})
    install(TARGETS volalign_${component}_component EXPORT volalign_${component} COMPONENT ${component})
  endif()
  install(EXPORT volalign_${component} NAMESPACE volalign:: FILE ${component}-targets.cmake
    DESTINATION "${VOLALIGN_PACKAGE_FOLDER}" COMPONENT ${component})
endfunction()

volalign_component(core)
volalign_component(core_formats)
volalign_component(core_model)
if(VOLALIGN_WITH_INFER)
  volalign_component(calibration MODULES volalign_infer_calib)
  volalign_component(files MODULES volalign_infer_capture volalign_infer_rigcheck)
  volalign_component(segmentation_onnx MODULES volalign_infer_segment_onnx)
endif()
volalign_component(render)
if(VOLALIGN_WITH_TORCH)
  volalign_component(nn MODULES volalign_core_nn)
  volalign_component(train)
  volalign_component(cli)
  if(VOLALIGN_WITH_INFER)
    volalign_component(segmentation MODULES volalign_infer_segment)
  endif()
endif()

configure_package_config_file("${PROJECT_SOURCE_DIR}/cmake/volalign-config.cmake.in" "${PROJECT_BINARY_DIR}/volalign-config.cmake"
  INSTALL_DESTINATION "${VOLALIGN_PACKAGE_FOLDER}" NO_SET_AND_CHECK_MACRO NO_CHECK_REQUIRED_COMPONENTS_MACRO)
# Before 1.0, a minor version may change the API.
write_basic_package_version_file("${PROJECT_BINARY_DIR}/volalign-config-version.cmake" COMPATIBILITY SameMinorVersion)
install(FILES "${PROJECT_BINARY_DIR}/volalign-config.cmake" "${PROJECT_BINARY_DIR}/volalign-config-version.cmake"
  DESTINATION "${VOLALIGN_PACKAGE_FOLDER}" COMPONENT core)
