#pragma once

#include <string>

#include "core/config/config_word.h"

namespace volalign {

enum class SensorStatus { kOk, kWeak, kFailed };
constexpr Words<SensorStatus, 3> WordsOf(SensorStatus) {
  return {{{"ok", SensorStatus::kOk},
           {"weak", SensorStatus::kWeak},
           {"failed", SensorStatus::kFailed}}};
}

/// Reasons why a sensor is failed or weak.
enum class SensorCode {
  kNone,  ///< of a sensor that is ok
  // Failed: the sensor has no pose.
  kNoDepth,
  kWrongUnits,
  kNoStructure,
  kDegenerateSides,
  kInconsistent,
  kAssemblyMirrored,
  kAssemblyTurned,
  kAssemblySwapped,
  kAssemblyMissing,
  kAssemblyShifted,
  kAssemblyHeight,
  kFrameMirrored,
  kUnconnected,
  // Failed or weak.
  kDuplicateDepth,
  kIntrinsicsSuspect,
  kDisagrees,
  kNotFinite,  ///< the solver left numbers that are not finite
  // Weak: the sensor has a pose to be used with care.
  kAmbiguous,
  kUnsolved,
  kUnsettled,
  kSamePose,
  kByNeighbours,  ///< of older calibrations alone
  kFewInliers,
  kLargeResidual,
  kLabelsDisagree,
  kLensSuspect,
  kUncertain,
  kTypicalIntrinsics
};
constexpr Words<SensorCode, 29> WordsOf(SensorCode) {
  return {{
      {"", SensorCode::kNone},
      {"no_depth", SensorCode::kNoDepth},
      {"wrong_units", SensorCode::kWrongUnits},
      {"no_structure", SensorCode::kNoStructure},
      {"degenerate_sides", SensorCode::kDegenerateSides},
      {"inconsistent", SensorCode::kInconsistent},
      {"assembly_mirrored", SensorCode::kAssemblyMirrored},
      {"assembly_turned", SensorCode::kAssemblyTurned},
      {"assembly_swapped", SensorCode::kAssemblySwapped},
      {"assembly_missing", SensorCode::kAssemblyMissing},
      {"assembly_shifted", SensorCode::kAssemblyShifted},
      {"assembly_height", SensorCode::kAssemblyHeight},
      {"frame_mirrored", SensorCode::kFrameMirrored},
      {"unconnected", SensorCode::kUnconnected},
      {"duplicate_depth", SensorCode::kDuplicateDepth},
      {"intrinsics_suspect", SensorCode::kIntrinsicsSuspect},
      {"disagrees", SensorCode::kDisagrees},
      {"ambiguous", SensorCode::kAmbiguous},
      {"not_finite", SensorCode::kNotFinite},
      {"unsolved", SensorCode::kUnsolved},
      {"unsettled", SensorCode::kUnsettled},
      {"same_pose", SensorCode::kSamePose},
      {"by_neighbours", SensorCode::kByNeighbours},
      {"few_inliers", SensorCode::kFewInliers},
      {"large_residual", SensorCode::kLargeResidual},
      {"labels_disagree", SensorCode::kLabelsDisagree},
      {"lens_suspect", SensorCode::kLensSuspect},
      {"uncertain", SensorCode::kUncertain},
      {"typical_intrinsics", SensorCode::kTypicalIntrinsics},
  }};
}

/// The reason why a sensor has no pose, or a doubt about its pose.
struct Finding {
  SensorCode code = SensorCode::kNone;
  std::string reason;  ///< a sentence
  std::string hint;    ///< what to do about it
};

}  // namespace volalign
