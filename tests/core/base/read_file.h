#pragma once

#include <filesystem>
#include <string>

#include "core/base/file_limits.h"
#include "core/base/file_util.h"

namespace volalign {

/// A file of the test's own.
inline std::string ReadFile(const std::filesystem::path& path) {
  return ReadFile(path, kMaxModelBytes);
}

}  // namespace volalign
