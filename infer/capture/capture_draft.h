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

}  // namespace volalign
