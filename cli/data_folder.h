#pragma once

#include <string>

namespace volalign {

/// The folder with configs and models: `given` (--data-dir; throws IoError if they are not there),
/// else the environment's VOLALIGN_DATA_DIR, else the folder beside the program. That is the source
/// tree in which it was built, or ../share/volalign of an installed program. "" if none is found.
std::string FindDataFolder(const std::string& given);

/// The message with the path of a page in place of its name, such as docs/formats.md, if it is
/// found. It may be beside the data folder's configs, or in share/doc/volalign of an installed
/// program.
std::string WithPages(const std::string& message);

/// An addition to a message about a missing file of the data folder, if no data folder was found:
/// how to name it. Else "".
std::string DataFolderHint(const std::string& message);

}  // namespace volalign
