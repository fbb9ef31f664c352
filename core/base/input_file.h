#pragma once

#include <filesystem>
#include <string>

namespace volalign {

/// The folder that has `configs` and `models`: relative paths of inputs that are not in the working
/// directory are looked for there. At first DataFolderNear of the running program; "": nowhere
/// else. A program sets it before it starts a thread.
void SetDataFolder(const std::string& folder);
const std::string& DataFolder();

/// Whether configs/structure.yaml is in the folder.
bool IsDataFolder(const std::filesystem::path& folder);

/// The environment's VOLALIGN_DATA_DIR, else the nearest folder above `file`, a program or a
/// module, that has data or share/volalign with data: the source tree that it was built in, or the
/// prefix where it was installed. "" where none is found.
std::string DataFolderNear(const std::filesystem::path& file);

/// `path` or, where only that exists, the same path in the data folder. Structures, intrinsics
/// pools, recipes, rigs and checkpoints are read through it.
std::string FindInputFile(const std::string& path);

/// Throws IoError when the file that the configuration's `key` names is not there, with the folders
/// that a relative path was looked for in and how to give another file.
void RequireInputFile(const std::string& key, const std::string& path);

}  // namespace volalign
