# Text files as string constants of a C++ file, so that a program carries them.
#
# volalign_embed_text(OUTPUT HEADER NAMESPACE kName=path ...): OUTPUT is a .cc of the build folder, made again where one of the files
# has changed. HEADER declares the constants. A text must not contain )text".
function(volalign_embed_text output header namespace)
  set(content "#include \"${header}\"\n\nnamespace ${namespace} {\n")
  foreach(item IN LISTS ARGN)
    string(REGEX MATCH "^([^=]*)=(.*)$" item "${item}")
    set(name "${CMAKE_MATCH_1}")
    set(file "${CMAKE_MATCH_2}")
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS "${file}")
    file(READ "${file}" text)
    string(FIND "${text}" ")text\"" end)
    if(NOT end EQUAL -1)
      message(FATAL_ERROR "${file} contains )text\", which ends a raw string")
    endif()
    string(APPEND content "\nconst char ${name}[] = R\"text(${text})text\";\n")
  endforeach()
  string(APPEND content "\n}  // namespace ${namespace}\n")
  file(CONFIGURE OUTPUT "${output}" CONTENT "@content@" @ONLY)  # which leaves an equal file as it is
endfunction()
