# CPack runs this between installing and packing: in /usr, Debian's Python looks for packages of all its versions in one folder.
file(GLOB folders "${CPACK_TEMPORARY_INSTALL_DIRECTORY}/*/usr/lib/python3.*")
foreach(folder IN LISTS folders)
  string(REGEX REPLACE "python3\\.[0-9]+$" "python3" target "${folder}")
  file(RENAME "${folder}" "${target}")
endforeach()
