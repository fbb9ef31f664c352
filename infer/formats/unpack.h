#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>

#include "core/base/interrupt.h"
#include "infer/formats/read_budget.h"

namespace volalign::formats_internal {

/// Unpacks an lz4 frame of `size` bytes. Throws DataError.
std::string UnpackLz4(std::string_view packed, std::size_t size, const std::string& name);

/// Do the bytes begin as those of zstd?
bool IsZstd(std::string_view bytes);

/// Unpacks bytes of zstd, counted by `budget`. Throws DataError, also for more than `most` bytes.
std::string UnpackZstd(std::string_view packed, std::size_t most, const std::string& name,
                       ReadBudget* budget);

/// Unpacks at most `count` bytes of the front of a file of zstd; fewer if it is damaged.
std::string FrontOfZstd(const std::filesystem::path& path, std::size_t count);

/// A whole file of zstd, unpacked into a temporary file, which goes with this object.
class UnpackedFile {
 public:
  /// Throws IoError, or DataError, which `name` begins.
  UnpackedFile(const std::filesystem::path& path, const std::string& name, ReadBudget* budget);

  const std::filesystem::path& path() const { return file_.path(); }

 private:
  TemporaryPath file_;
};

}  // namespace volalign::formats_internal
