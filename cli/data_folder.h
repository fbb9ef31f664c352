#pragma once

#include <string>

namespace volalign {

/// The folder that has configs and models: `given` (--data-dir; throws IoError where it has none),
/// else the environment's VOLALIGN_DATA_DIR, else what stands beside the program: the source tree
/// that it was built in, or ../share/volalign where it was installed. "" where none is found.
std::string FindDataFolder(const std::string& given);

/// A message in which the name of a page, as docs/formats.md, is its path, where it is found:
/// beside the data folder's configs, or in share/doc/volalign of an installed program.
std::string WithPages(const std::string& message);

/// What to add to a message about a file that is not there: how to name the data folder, where none
/// was found and the message is about something in it; else "".
std::string DataFolderHint(const std::string& message);

}  // namespace volalign
