#pragma once

#include <string>

namespace volalign {

/// The folder that has configs and models: `given` (--data-dir; throws IoError where it has none),
/// else the environment's VOLALIGN_DATA_DIR, else what stands beside the program: the source tree
/// that it was built in, or ../share/volalign where it was installed. "" where none is found.
std::string FindDataFolder(const std::string& given);

}  // namespace volalign
