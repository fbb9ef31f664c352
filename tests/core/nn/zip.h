#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace volalign {

inline std::string LittleEndian(std::uint64_t number, int bytes) {
  std::string text;
  for (int i = 0; i < bytes; ++i) text += static_cast<char>(number >> (8 * i));
  return text;
}

inline std::uint32_t Crc32(const std::string& bytes) {
  std::uint32_t crc = ~std::uint32_t{0};
  for (const char c : bytes) {
    crc ^= static_cast<unsigned char>(c);
    for (int bit = 0; bit < 8; ++bit) crc = crc >> 1 ^ (crc & 1 ? 0xedb88320 : 0);
  }
  return ~crc;
}

/// A zip archive of files that are stored, or are said to be packed by `method`. A
/// file without content has the bytes of the one before it, as a second entry.
inline std::string Zip(const std::vector<std::pair<std::string, std::string>>& files,
                       std::uint64_t method = 0) {
  std::string bytes, list;
  std::size_t at = 0, size = 0;
  std::uint32_t checksum = 0;
  for (const auto& file : files) {
    const std::string &name = file.first, &content = file.second;
    const auto header = [&] {
      return LittleEndian(method, 2) + LittleEndian(0, 4) + LittleEndian(checksum, 4) +
             LittleEndian(size, 4) + LittleEndian(size, 4) + LittleEndian(name.size(), 2) +
             LittleEndian(0, 2);
    };
    const std::string version = LittleEndian(20, 2);
    if (!content.empty()) {
      at = bytes.size();
      size = content.size();
      checksum = Crc32(content);
      bytes += "PK\x03\x04" + version + LittleEndian(0, 2) + header() + name + content;
    }
    list += "PK\x01\x02" + version + version + LittleEndian(0, 2) + header() +
            std::string(10, '\0') + LittleEndian(at, 4) + name;
  }
  const std::string count = LittleEndian(files.size(), 2);
  return bytes + list + "PK\x05\x06" + std::string(4, '\0') + count + count +
         LittleEndian(list.size(), 4) + LittleEndian(bytes.size(), 4) + LittleEndian(0, 2);
}

}  // namespace volalign
