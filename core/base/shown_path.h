#pragma once

#include <filesystem>
#include <string>

#include "core/base/text.h"

namespace volalign {

/// A path for a message: Shortened. Linux has no path of more than 4,096 bytes, and hardly anybody
/// one of more than 500.
inline std::string ShownPath(const std::filesystem::path& path) {
  return Shortened(path.string(), 500);
}

}  // namespace volalign
