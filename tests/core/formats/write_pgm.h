#pragma once

#include <fmt/format.h>

#include <filesystem>
#include <string>

#include "core/base/file_util.h"
#include "core/base/image.h"

namespace volalign {

/// Binary PGM (P5), 16 bits, big-endian as the format demands.
inline void WritePgm(const std::filesystem::path& path, const Image16& image) {
  std::string bytes = fmt::format("P5\n{} {}\n65535\n", image.width(), image.height());
  for (const std::uint16_t value : image) {
    bytes.push_back(static_cast<char>(value >> 8));
    bytes.push_back(static_cast<char>(value & 0xff));
  }
  WriteFileAtomically(path, bytes);
}

}  // namespace volalign
