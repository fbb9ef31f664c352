#include "core/base/input_file.h"

#include <fmt/format.h>

#include <cstdlib>
#include <filesystem>
#include <system_error>

#include "core/base/error.h"
#include "core/base/text.h"

namespace volalign {

namespace {

namespace fs = std::filesystem;

std::string& Folder() {
  std::error_code error;
  static std::string folder = DataFolderNear(fs::read_symlink("/proc/self/exe", error));
  return folder;
}

bool Exists(const fs::path& path) {
  std::error_code error;
  return fs::exists(path, error);
}

}  // namespace

void SetDataFolder(const std::string& folder) { Folder() = folder; }

const std::string& DataFolder() { return Folder(); }

bool IsDataFolder(const fs::path& folder) { return Exists(folder / "configs" / "structure.yaml"); }

std::string DataFolderNear(const fs::path& file) {
  if (const char* named = std::getenv("VOLALIGN_DATA_DIR"); named && IsDataFolder(named))
    return named;
  for (fs::path folder = file.parent_path(); folder.has_relative_path();
       folder = folder.parent_path()) {
    if (IsDataFolder(folder)) return folder.string();
    const fs::path shared = folder / "share" / "volalign";
    if (IsDataFolder(shared)) return shared.string();
  }
  return "";
}

std::string FindInputFile(const std::string& path) {
  if (Folder().empty() || path.empty() || fs::path(path).is_absolute() || Exists(path)) return path;
  const fs::path there = fs::path(Folder()) / path;
  return Exists(there) ? there.string() : path;
}

void RequireInputFile(const std::string& key, const std::string& path) {
  if (Exists(FindInputFile(path))) return;
  std::error_code error;
  std::string where = "no such file";
  if (!fs::path(path).is_absolute()) {
    where += fmt::format(" in the working directory {}", fs::current_path(error).string());
    where += Folder().empty() ? ", and no data folder was found, which VOLALIGN_DATA_DIR names"
                              : fmt::format(" or the data folder {}", Folder());
  }
  throw IoError(
      fmt::format("{} = {}: {}: run in the folder that holds it, or name another file by this key",
                  key, ShownPath(path), where));
}

}  // namespace volalign
