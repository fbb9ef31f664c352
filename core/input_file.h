#pragma once

#include <string>

namespace volalign {

/// Throws IoError when the file that the configuration's `key` names is not there, with the folder
/// that a relative path was looked for in and how to give another file.
void RequireInputFile(const std::string& key, const std::string& path);

}  // namespace volalign
