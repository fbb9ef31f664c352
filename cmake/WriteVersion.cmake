# cmake -D SOURCE=... -D VERSION=... -D OUTPUT=version.cc -P WriteVersion.cmake: writes the version and the commit of the source tree with its
# date, "" where the tree is neither a repository of its own nor an archive of one (.gitattributes); touches the file only where it changes.
file(READ "${SOURCE}/cmake/commit.txt" commit)
string(STRIP "${commit}" commit)
string(REGEX REPLACE "^(............)[0-9a-f]* of" "\\1 of" commit "${commit}")
if(commit MATCHES "Format")
  set(commit "")
  if(EXISTS "${SOURCE}/.git")
    execute_process(COMMAND git -C "${SOURCE}" -c "safe.directory=${SOURCE}" describe --always --dirty --abbrev=12 --exclude=*
      OUTPUT_VARIABLE commit OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
    execute_process(COMMAND git -C "${SOURCE}" -c "safe.directory=${SOURCE}" show --no-patch --format=%cs
      OUTPUT_VARIABLE date OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
    if(commit)
      set(commit "${commit} of ${date}")
    endif()
  endif()
endif()
file(CONFIGURE OUTPUT "${OUTPUT}" CONTENT [[
namespace volalign {
extern const char kVersion[], kCommit[];
const char kVersion[] = "@VERSION@";
const char kCommit[] = "@commit@";
}
]] @ONLY)
