#include "cli/data_folder.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <optional>
#include <string_view>
#include <system_error>

#include "core/base/error.h"
#include "core/base/input_file.h"

namespace volalign {

namespace fs = std::filesystem;

namespace {

/// The folder of docs/NAME: "" for the working folder, else beside the data or its documents.
std::optional<fs::path> FolderOf(const fs::path& page) {
  for (const fs::path& folder :
       {fs::path(), fs::path(DataFolder()), fs::path(DataFolder()) / "../doc/volalign"}) {
    std::error_code error;
    if (fs::exists(folder / page, error)) return folder;
  }
  return std::nullopt;
}

}  // namespace

std::string FindDataFolder(const std::string& given) {
  if (!given.empty()) {
    if (!IsDataFolder(given)) {
      throw IoError(fmt::format(
          "--data-dir {}: configs/structure.yaml is not in it; give the folder that has configs "
          "and models",
          given));
    }
    return given;
  }
  return DataFolder();
}

std::string WithPages(const std::string& message) {
  constexpr std::string_view kFolder = "docs/", kEnding = ".md";
  constexpr const char* kLetters = "abcdefghijklmnopqrstuvwxyz-";
  std::string text;
  std::size_t rest = 0;
  for (std::size_t at = 0; (at = message.find(kFolder, at)) != std::string::npos;) {
    const std::size_t name = at + kFolder.size();
    const std::size_t end = std::min(message.find_first_not_of(kLetters, name), message.size());
    if (end == name || message.compare(end, kEnding.size(), kEnding) != 0) {
      at = name;
      continue;
    }
    const fs::path page = message.substr(at, end + kEnding.size() - at);
    text += message.substr(rest, at - rest);
    text += (FolderOf(page).value_or(fs::path()) / page).lexically_normal().string();
    rest = at = end + kEnding.size();
  }
  return text + message.substr(rest);
}

std::string DataFolderHint(const std::string& message) {
  const bool of_data =
      message.find("configs/") != std::string::npos || message.find("models/") != std::string::npos;
  if (!DataFolder().empty() || !of_data) return "";
  return "; the program's own configs and models were not found: --data-dir FOLDER, or "
         "VOLALIGN_DATA_DIR in the environment, names the folder that has them";
}

}  // namespace volalign
