#pragma once

#include <string>
#include <utility>
#include <vector>

#include "core/config/config_word.h"
#include "core/geometry/structure.h"
#include "infer/refine/refine.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// Causes that make a whole calibration doubtful, whichever sensor shows them.
enum class RigCode {
  kSizeOff,          ///< all boxes are larger or smaller than described
  kBoxOff,           ///< one box is another than described, or stands elsewhere
  kDepthOff,         ///< a sensor's depths have an error that its kind does not have
  kPairApart,        ///< two sensors measured one surface in two places
  kFilesExchanged,   ///< two sensors' depth files seem to be exchanged
  kDepthScale,       ///< depths fit the structure in another unit
  kPriorOff,         ///< frames contradict what was known of poses beforehand
  kStructureAssumed  ///< no structure was given, and few sensors see the one that is assumed
};
constexpr Words<RigCode, 8> WordsOf(RigCode) {
  return {{
      {"size_off", RigCode::kSizeOff},
      {"box_off", RigCode::kBoxOff},
      {"depth_off", RigCode::kDepthOff},
      {"pair_apart", RigCode::kPairApart},
      {"files_exchanged", RigCode::kFilesExchanged},
      {"depth_scale", RigCode::kDepthScale},
      {"prior_off", RigCode::kPriorOff},
      {"structure_assumed", RigCode::kStructureAssumed},
  }};
}

struct RigFinding {
  RigCode code = RigCode::kSizeOff;
  std::vector<std::string> about;  ///< names of the sensors or of the box; empty: all
  std::string reason;              ///< sentences
  std::string hint;                ///< what to do about it
};

/// Findings about each quantity that is more than kClearly off its prior, and about the box that
/// explains why the frames contradict each other. `sensors`: names of the refined frames.
std::vector<RigFinding> ExplainQuantities(const RefineResult& refined,
                                          const std::vector<std::string>& sensors,
                                          const Structure& structure);

/// Findings about sides that two frames or more should show but that something nearer hides for the
/// most part, and about upper sides on which two frames measure something. It may be a box that the
/// structure does not have. `frames`: views with their structure_from_sensor.
std::vector<RigFinding> FindCoveredSides(
    const std::vector<std::pair<const SensorView*, Pose>>& frames, const Structure& structure);

/// Findings about pairs of sensors whose points are farther apart than their errors predict.
/// Sensors whose points are farther from all others' than those are from each other follow.
std::vector<RigFinding> FindPairsApart(const RefineResult& refined,
                                       const std::vector<std::string>& sensors);

}  // namespace volalign
