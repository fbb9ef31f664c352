#pragma once

#include <string>
#include <vector>

namespace volalign {

enum class SensorStatus { kOk, kWeak, kFailed };
const char* ToString(SensorStatus status);  ///< "ok", "weak", "failed"
std::vector<SensorStatus> AllOf(SensorStatus);

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
  kAmbiguous,
  kNotFinite,  ///< the solver left numbers that are not finite
  // Weak: the sensor has a pose to be used with care.
  kUnsolved,
  kUnsettled,
  kSamePose,
  kByNeighbours,
  kFewInliers,
  kLargeResidual,
  kLabelsDisagree,
  kLensSuspect,
  kUncertain,
  kTypicalIntrinsics
};
/// The word in files and reports: "no_depth", "assembly_mirrored", ...; "" for kNone.
const char* ToString(SensorCode code);
std::vector<SensorCode> AllOf(SensorCode);

/// The reason why a sensor has no pose, or a doubt about its pose.
struct Finding {
  SensorCode code = SensorCode::kNone;
  std::string reason;  ///< a sentence
  std::string hint;    ///< what to do about it
};

}  // namespace volalign
