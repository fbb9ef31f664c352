#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>

#include "infer/formats/read_budget.h"

namespace volalign::formats_internal {

/// An lz4 frame of `size` bytes, unpacked. Throws DataError.
std::string UnpackLz4(std::string_view packed, std::size_t size, const std::string& name);

/// Whether the bytes begin as zstd does.
bool IsZstd(std::string_view bytes);

/// What zstd packed, counted by `budget`. Throws DataError, also for more than `most` bytes.
std::string UnpackZstd(std::string_view packed, std::size_t most, const std::string& name,
                       ReadBudget* budget);

/// At most `count` bytes of the front of a file that zstd packed; fewer where it is damaged.
std::string FrontOfZstd(const std::filesystem::path& path, std::size_t count);

/// A whole file that zstd packed, unpacked into memory, as a file without a name.
class UnpackedFile {
 public:
  /// Throws IoError, or DataError, which `name` begins.
  UnpackedFile(const std::filesystem::path& path, const std::string& name, ReadBudget* budget);
  ~UnpackedFile();
  UnpackedFile(const UnpackedFile&) = delete;
  UnpackedFile& operator=(const UnpackedFile&) = delete;

  std::filesystem::path path() const;  ///< by which it can be opened as long as this lives

 private:
  int descriptor_;
};

}  // namespace volalign::formats_internal
