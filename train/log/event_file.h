#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/base/image.h"

namespace volalign {

/// Castagnoli's CRC-32, as in the records of an event file.
std::uint32_t Crc32c(std::string_view bytes);

/// A TensorBoard event file: TFRecord frames (TensorFlow's record_writer.cc) of the messages of
/// event.proto. Events are flushed one by one. Throws IoError if writing fails.
class EventFile {
 public:
  /// A new file in `folder`. It sorts after those of earlier writers, in the order in which
  /// TensorBoard reads them.
  explicit EventFile(const std::filesystem::path& folder);

  /// Makes the events of earlier files from `step` on void: they come again.
  void Restart(std::int64_t step);
  /// Writes values by tag, all of one step.
  void Scalars(std::int64_t step, const std::vector<std::pair<std::string, double>>& values);
  void Picture(std::int64_t step, const std::string& tag, const RgbImage& picture);
  /// Writes a text, which is shown as Markdown.
  void Text(std::int64_t step, const std::string& tag, const std::string& markdown);

  const std::filesystem::path& path() const { return path_; }

 private:
  void Write(const std::string& event);

  std::filesystem::path path_;
  std::ofstream file_;
};

}  // namespace volalign
