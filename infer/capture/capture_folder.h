#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace volalign {

/// What lies in one folder, sub-folders apart.
struct FolderContent {
  std::vector<std::filesystem::path> images, recordings, intrinsics;
  std::vector<std::string> left_out;  ///< names
};

/// Looks at the files of a folder; numbers in names count as numbers, frame_9 before frame_10.
/// Throws DataError for a path that is not UTF-8, which a capture.json cannot name.
FolderContent LookInto(const std::filesystem::path& folder);

/// Whether a file's name comes before another's, by the same order.
bool ComesBefore(const std::filesystem::path& a, const std::filesystem::path& b);

/// Of a file's name without its ending: "KA03_Depth_0007" -> "KA03"; "" where nothing but the word
/// depth is there; none without the word.
std::optional<std::string> NameBesideDepth(const std::string& stem);

/// "frame_0007" -> "frame_".
std::string WithoutNumber(const std::string& stem);

}  // namespace volalign
