#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/camera.h"

namespace volalign {

struct CaptureDraftOptions {
  bool typical = false;  ///< use typical intrinsics of their kind for sensors without any
  std::optional<std::filesystem::path> structure;  ///< file of the structure that the sensors see
  // For sensors that do not state theirs:
  std::optional<double> depth_scale;
  std::optional<std::filesystem::path> intrinsics;  ///< a file
  std::string sensor;                               ///< kind
};

/// A capture.json made from the files in a folder.
struct CaptureDraft {
  std::string json;  ///< keys that are not known are absent
  int sensors = 0;
  std::vector<std::string> found;    ///< sentences: how each file was taken
  std::vector<std::string> unknown;  ///< sentences: missing values that have to be added
};

/// Drafts a capture.json from the depth files and recordings in `folder`. Images whose name says
/// that they are something else (colour, infrared, labels, ...) are left out.
///
/// A sub-folder with depth files is a sensor of its name, and all its frames are one capture.
/// Beside sub-folders, NAME_depth, NAME_depth_0001 and so on are frames of the sensor NAME; depth
/// may stand before the name, in capitals too. Files that differ only in a number, as frames do
/// (IsNamedAsFrame), and see the same are frames of one sensor. Each other file is a sensor of its
/// own. A recording is a sensor of its name, or one for each depth stream. Only the first part of a
/// recording of `ros2 bag` counts.
///
/// Intrinsics are those of the recording, of a file in the sub-folder, of one that begins with the
/// sensor's name, or of the folder's only other one. Units and intrinsics are never guessed.
/// Recordings are read as far as ReadCapture reads them. Paths in the JSON are relative to
/// `output_folder`. Throws ConfigError for an unknown kind and for an option that no sensor needs.
/// Throws IoError if there is no such folder, and DataError if no depth is in it.
CaptureDraft DraftCapture(const std::filesystem::path& folder,
                          const std::filesystem::path& output_folder,
                          const CaptureDraftOptions& options);

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
