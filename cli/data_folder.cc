#include "cli/data_folder.h"

#include <fmt/format.h>

#include <cstdlib>
#include <filesystem>
#include <system_error>

#include "core/base/error.h"

namespace volalign {

namespace {

namespace fs = std::filesystem;

bool HasData(const fs::path& folder) {
  std::error_code error;
  return fs::exists(folder / "configs" / "structure.yaml", error);
}

}  // namespace

std::string FindDataFolder(const std::string& given) {
  if (!given.empty()) {
    if (!HasData(given)) {
      throw IoError(fmt::format(
          "--data-dir {}: configs/structure.yaml is not in it; give the folder that has configs "
          "and models",
          given));
    }
    return given;
  }
  if (const char* named = std::getenv("VOLALIGN_DATA_DIR"); named && HasData(named)) return named;
  std::error_code error;
  const fs::path program = fs::read_symlink("/proc/self/exe", error);
  for (fs::path folder = program.parent_path(); folder.has_relative_path();
       folder = folder.parent_path()) {
    if (HasData(folder)) return folder.string();
    if (HasData(folder / "share" / "volalign")) return (folder / "share" / "volalign").string();
  }
  return "";
}

}  // namespace volalign
