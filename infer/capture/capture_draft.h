#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/camera.h"

namespace volalign {

struct CaptureDraftOptions {
  bool typical = false;  ///< sensors without intrinsics have those typical of their kind
  std::optional<std::filesystem::path> structure;  ///< what the sensors see
  // Each of the sensors that do not state theirs.
  std::optional<double> depth_scale;
  std::optional<std::filesystem::path> intrinsics;  ///< a file
  std::string sensor;                               ///< kind
};

/// A capture.json made from what lies in a folder.
struct CaptureDraft {
  std::string json;  ///< keys that are not known are absent
  int sensors = 0;
  std::vector<std::string> found;    ///< sentences: what was taken for what
  std::vector<std::string> unknown;  ///< sentences: what has to be added before it can be read
};

/// Looks for depth files and recordings in `folder`:
/// - a sub-folder that has some is a sensor of its name, and all its frames are one still;
/// - of files beside them, NAME_depth, NAME_depth_0001 and so on are frames of the sensor NAME
///   (depth may stand before the name, in capitals too), and so are files that differ in a number
///   alone, as frames do (IsNamedAsFrame), and see the same; each other file is a sensor of its
///   own;
/// - a recording is a sensor of its name, or one for each depth stream; of the parts of one of
///   `ros2 bag` the first alone.
/// Images whose name says that they are something else (colour, infrared, labels, ...) are left
/// out. Intrinsics are those of a file in the sub-folder, of one that begins with the sensor's
/// name, of the recording, or of the only other one in the folder. Units and intrinsics are never
/// guessed. Recordings are read as far as ReadCapture reads them. Paths in the JSON are relative to
/// `output_folder`. Throws ConfigError for a kind that is not known and for an option that no
/// sensor needs, IoError where there is no such folder, DataError where no depth is in it.
CaptureDraft DraftCapture(const std::filesystem::path& folder,
                          const std::filesystem::path& output_folder,
                          const CaptureDraftOptions& options);

}  // namespace volalign
