#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace volalign {

/// The files in one folder, without sub-folders.
struct FolderContent {
  std::vector<std::filesystem::path> images, recordings, intrinsics;
  std::vector<std::string> left_out;  ///< images named as something else
  /// Sentences on files that may be meant as intrinsics or as recordings and are not read.
  std::vector<std::string> not_understood, not_read;
};

/// Sorts the files of a folder by kind. Numbers in names count as numbers, frame_9 before frame_10.
/// Throws DataError for a path that is not UTF-8, which a capture.json cannot name.
FolderContent LookInto(const std::filesystem::path& folder);

/// Does a file's name come before another's in this order?
bool ComesBefore(const std::filesystem::path& a, const std::filesystem::path& b);

/// The sensor's part of a file's name without its ending: "KA03_Depth_0007" -> "KA03". It is "" if
/// there is only the word depth, and absent without the word.
std::optional<std::string> NameBesideDepth(const std::string& stem);

/// Does the name have a number as frames of one sensor have it, and sensors do not? That is a time,
/// a number of three or more digits that begins with 0, or any number beside the word frame or
/// image.
bool IsNamedAsFrame(const std::string& stem);

/// "frame_0007" -> "frame_".
std::string WithoutNumber(const std::string& stem);

}  // namespace volalign
