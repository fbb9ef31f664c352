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

/// Castagnoli's CRC-32, which frames the records of an event file.
std::uint32_t Crc32c(std::string_view bytes);

/// A TensorBoard event file: TFRecord frames of `Event` protocol buffers, as TensorFlow's
/// record_writer.cc, event.proto and summary.proto define them, written field by field. Events are
/// flushed one by one. Throws IoError when writing fails.
class EventFile {
 public:
  /// A new file in `folder`, which sorts after those of earlier writers, as TensorBoard reads them.
  explicit EventFile(const std::filesystem::path& folder);

  /// What earlier files say of `step` and later steps is void: they come again.
  void Restart(std::int64_t step);
  /// Values by tag, all of one step.
  void Scalars(std::int64_t step, const std::vector<std::pair<std::string, double>>& values);
  void Picture(std::int64_t step, const std::string& tag, const RgbImage& picture);
  /// Shown as Markdown.
  void Text(std::int64_t step, const std::string& tag, const std::string& markdown);

  const std::filesystem::path& path() const { return path_; }

 private:
  void Write(const std::string& event);

  std::filesystem::path path_;
  std::ofstream file_;
};

}  // namespace volalign
