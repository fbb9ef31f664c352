#pragma once

#include <string>
#include <utility>
#include <vector>

#include "core/geometry/structure.h"
#include "infer/refine/refine.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// What makes a whole calibration doubtful, whichever sensor shows it.
enum class RigCode {
  kSizeOff,          ///< all boxes are larger or smaller than described
  kBoxOff,           ///< one box is another than described, or stands elsewhere
  kDepthOff,         ///< a sensor's depths have an error that its kind does not have
  kPairApart,        ///< two sensors measured one surface in two places
  kFilesExchanged,   ///< two sensors' depth files seem to be exchanged
  kDepthScale,       ///< depths fit the structure in another unit
  kStructureAssumed  ///< no structure was given, and few sensors see the one that is assumed
};
/// As files and reports have it: "size_off", "box_off", "depth_off", "pair_apart",
/// "files_exchanged", "depth_scale", "structure_assumed".
const char* ToString(RigCode code);
std::vector<RigCode> AllOf(RigCode);

struct RigFinding {
  RigCode code = RigCode::kSizeOff;
  std::vector<std::string> about;  ///< names of the sensors or of the box; empty: all
  std::string reason;              ///< sentences
  std::string hint;                ///< what to do about it
};

/// Of each quantity that is more than kClearly off what was known of it before, and of the box that
/// explains why the frames contradict each other. `sensors`: of the frames that were refined.
std::vector<RigFinding> ExplainQuantities(const RefineResult& refined,
                                          const std::vector<std::string>& sensors,
                                          const Structure& structure);

/// Of each side that two frames or more should show, and before most of which something nearer
/// lies: perhaps a box that the structure does not have. `frames`: views with their
/// structure_from_sensor.
std::vector<RigFinding> FindCoveredSides(
    const std::vector<std::pair<const SensorView*, Pose>>& frames, const Structure& structure);

/// Of each two sensors whose points are farther apart than their errors let expect; and of each
/// sensor whose points are farther apart from all others' than those are from each other.
std::vector<RigFinding> FindPairsApart(const RefineResult& refined,
                                       const std::vector<std::string>& sensors);

}  // namespace volalign
