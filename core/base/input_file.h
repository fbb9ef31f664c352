#pragma once

#include <filesystem>
#include <string>

namespace volalign {

/// The folder that has `configs` and `models`. Relative paths of inputs are looked for in the
/// working directory, then there. At first it is DataFolderNear of the running program. "": no such
/// folder. A program sets it before it starts a thread.
void SetDataFolder(const std::string& folder);
const std::string& DataFolder();

/// Whether configs/structure.yaml is in the folder.
bool IsDataFolder(const std::filesystem::path& folder);

/// The environment's VOLALIGN_DATA_DIR. Else the nearest folder above `file`, a program or a
/// module, that has data or share/volalign with data. This is the source tree of the build, or the
/// prefix of the installation. Else "".
std::string DataFolderNear(const std::filesystem::path& file);

/// `path` or, if only that exists, the same path in the data folder. Structures, intrinsics pools,
/// recipes, rigs and checkpoints are read through it.
std::string FindInputFile(const std::string& path);

/// Throws IoError if the file that the configuration's `key` names does not exist. The message has
/// the folders that were searched and how to give another file.
void RequireInputFile(const std::string& key, const std::string& path);

}  // namespace volalign
