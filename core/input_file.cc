#include "core/input_file.h"

#include <fmt/format.h>

#include <filesystem>
#include <system_error>

#include "core/error.h"

namespace volalign {

void RequireInputFile(const std::string& key, const std::string& path) {
  namespace fs = std::filesystem;
  std::error_code error;
  if (fs::exists(path, error)) return;
  const std::string where = fs::path(path).is_absolute()
                                ? "no such file"
                                : fmt::format("no such file in the working directory {}",
                                              fs::current_path(error).string());
  throw IoError(fmt::format(
      "{} = {}: {}: run volalign in the folder that holds it, or name another file: --set {}=FILE",
      key, path, where, key));
}

}  // namespace volalign
