#include "cli/data_folder.h"

#include <fmt/format.h>

#include <filesystem>
#include <system_error>

#include "core/base/error.h"
#include "core/base/input_file.h"

namespace volalign {

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
  std::error_code error;
  return DataFolderNear(std::filesystem::read_symlink("/proc/self/exe", error));
}

}  // namespace volalign
