#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "core/base/image.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/view/sensor_frame.h"
#include "render/rig.h"

namespace volalign {

class DepthRenderer;

/// The same sensors while the structure stands elsewhere. Frames are in the order of the first
/// capture.
struct FurtherCapture {
  std::vector<SensorFrame> frames;
  std::vector<LabelImage> labels;
};

/// A capture of a rig, or the first of several, with the truth about it.
struct EvaluationCapture {
  Structure structure;              ///< nominal
  std::vector<SensorFrame> frames;  ///< with ground truth if there is one
  std::vector<LabelImage> labels;   ///< true labels of each sensor; empty for a real capture
  /// Best rigid fit of the boxes' corners as they stand onto the nominal ones. No capture can tell
  /// the nominal frame from the one in which the boxes' displacements average out.
  Pose nominal_from_built = Pose::Identity();
  std::vector<FurtherCapture> further;  ///< of the other placements
};

/// A capture that is made when its turn comes.
struct EvaluationItem {
  std::string rig;      ///< name of the rig, or the capture's path
  std::string sensors;  ///< pool name of all sensors; "as the rig"; "" for a capture
  std::optional<std::uint64_t> seed;
  int placements = 1;
  std::string identity;  ///< everything that the capture depends on
  std::function<EvaluationCapture()> load;
};

/// The capture of a rendered rig.
EvaluationCapture EvaluationCaptureOf(const RigCapture& capture);

/// The captures of a rig's placements; not empty.
EvaluationCapture EvaluationCaptureOf(const std::vector<RigCapture>& placements);

/// A rig to render. `sensors`, if not empty, replaces every sensor's own model, at the pool's own
/// image size. The renderer must outlive the item. Throws IoError if the structure or the
/// intrinsics cannot be read.
EvaluationItem RigItem(const std::string& name, Rig rig, const std::string& sensors,
                       DepthRenderer* renderer);

/// A capture.json, with the structure that it names, else `structure`. Throws IoError.
EvaluationItem CaptureItem(const std::filesystem::path& path, const Structure& structure);

/// Rigs to render under several seeds and with several kinds of sensors.
struct RigSeries {
  std::vector<std::string> files;    ///< rig.yaml
  std::vector<std::string> changes;  ///< KEY=VALUE over every rig
  /// Pool names; all sensors are set to each in turn. Empty: the rig's own.
  std::vector<std::string> sensors;
  std::vector<std::uint64_t> seeds;  ///< empty: the rig's own
  /// false: each seed turns the structure by a golden angle more, so that no two face the sensors
  /// alike.
  bool keep_yaw = false;
  /// Numbers of placements; every rig has each in turn. Its own come first, then drawn ones
  /// (DrawPlacements). Empty: the rig's own.
  std::vector<int> placements;
  double placement_radius_m = 0.8;
};

/// A rig of a series, named after its file: "configs/rig_ring8.yaml" is "ring8".
struct NamedRig {
  std::string name;
  Rig rig;
};

/// Reads the rigs. Throws IoError or ConfigError, also for two rigs of one name.
std::vector<NamedRig> ReadRigs(const RigSeries& series);

/// Every rig x kind of sensors x number of placements x seed x turn of the rig, in this order.
/// Throws as RigItem and DrawPlacements.
std::vector<EvaluationItem> RigItems(const std::vector<NamedRig>& rigs, const RigSeries& series,
                                     DepthRenderer* renderer);

/// Parses "1000:1020" (1000 to 1019), "7" or "1,5,9". Throws ConfigError.
std::vector<std::uint64_t> ParseSeeds(const std::string& text);

}  // namespace volalign
