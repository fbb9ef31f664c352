#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace volalign {

/// What lies in one folder, sub-folders apart.
struct FolderContent {
  std::vector<std::filesystem::path> images, recordings, intrinsics;
  std::vector<std::string> left_out;  ///< names of images that are called something else
  /// Sentences, of files that may be meant as intrinsics, or as recordings, and are not read.
  std::vector<std::string> not_understood, not_read;
};

/// Looks at the files of a folder; numbers in names count as numbers, frame_9 before frame_10.
/// Throws DataError for a path that is not UTF-8, which a capture.json cannot name.
FolderContent LookInto(const std::filesystem::path& folder);

/// Whether a file's name comes before another's, by the same order.
bool ComesBefore(const std::filesystem::path& a, const std::filesystem::path& b);

/// Of a file's name without its ending: "KA03_Depth_0007" -> "KA03"; "" where nothing but the word
/// depth is there; none without the word.
std::optional<std::string> NameBesideDepth(const std::string& stem);

/// Whether the name has a number as frames of one sensor have it, and sensors do not: a time, one
/// that begins with 0 and has three digits or more, or behind the word frame or image.
bool IsNamedAsFrame(const std::string& stem);

/// "frame_0007" -> "frame_".
std::string WithoutNumber(const std::string& stem);

}  // namespace volalign
