# Text files as string constants of a C++ file, so that a program carries them.
#
# volalign_embed_text(OUTPUT HEADER NAMESPACE kName=path ...): OUTPUT is a .cc of the build folder, made again where one of the files
# has changed. HEADER declares the constants. A text must not contain )text".
# Also run as a script (cmake -D OUTPUT=... -P EmbedText.cmake) by the rule that it makes.
if(NOT CMAKE_SCRIPT_MODE_FILE)
  set(VOLALIGN_EMBED_SCRIPT "${CMAKE_CURRENT_LIST_FILE}")
  function(volalign_embed_text output header namespace)
    set(files "")
    foreach(item IN LISTS ARGN)
      string(REGEX REPLACE "^[^=]*=" "" file "${item}")
      list(APPEND files "${file}")
    endforeach()
    string(REPLACE ";" "|" items "${ARGN}")
    add_custom_command(
      OUTPUT "${output}"
      COMMAND "${CMAKE_COMMAND}" -D "OUTPUT=${output}" -D "HEADER=${header}" -D "NAMESPACE=${namespace}"
              -D "ITEMS=${items}" -P "${VOLALIGN_EMBED_SCRIPT}"
      DEPENDS ${files} "${VOLALIGN_EMBED_SCRIPT}"
      VERBATIM)
  endfunction()
  return()
endif()

file(WRITE "${OUTPUT}" "#include \"${HEADER}\"\n\nnamespace ${NAMESPACE} {\n")
string(REPLACE "|" ";" items "${ITEMS}")
foreach(item IN LISTS items)
  string(REGEX REPLACE "=.*" "" name "${item}")
  string(REGEX REPLACE "^[^=]*=" "" file "${item}")
  file(READ "${file}" text)
  string(FIND "${text}" ")text\"" end)
  if(NOT end EQUAL -1)
    message(FATAL_ERROR "${file} contains )text\", which ends a raw string")
  endif()
  file(APPEND "${OUTPUT}" "\nconst char ${name}[] = R\"text(")
  file(APPEND "${OUTPUT}" "${text}")
  file(APPEND "${OUTPUT}" ")text\";\n")
endforeach()
file(APPEND "${OUTPUT}" "\n}  // namespace ${NAMESPACE}\n")
