#include "infer/checks/outcome.h"

namespace volalign {

const char* ToString(SensorStatus status) {
  switch (status) {
    case SensorStatus::kOk:
      return "ok";
    case SensorStatus::kWeak:
      return "weak";
    case SensorStatus::kFailed:
      break;
  }
  return "failed";
}

const char* ToString(SensorCode code) {
  switch (code) {
    case SensorCode::kNone:
      break;
    case SensorCode::kNoDepth:
      return "no_depth";
    case SensorCode::kWrongUnits:
      return "wrong_units";
    case SensorCode::kNoStructure:
      return "no_structure";
    case SensorCode::kDegenerateSides:
      return "degenerate_sides";
    case SensorCode::kInconsistent:
      return "inconsistent";
    case SensorCode::kAssemblyMirrored:
      return "assembly_mirrored";
    case SensorCode::kAssemblyTurned:
      return "assembly_turned";
    case SensorCode::kAssemblySwapped:
      return "assembly_swapped";
    case SensorCode::kAssemblyMissing:
      return "assembly_missing";
    case SensorCode::kDuplicateDepth:
      return "duplicate_depth";
    case SensorCode::kIntrinsicsSuspect:
      return "intrinsics_suspect";
    case SensorCode::kSamePose:
      return "same_pose";
    case SensorCode::kAmbiguous:
      return "ambiguous";
    case SensorCode::kFewInliers:
      return "few_inliers";
    case SensorCode::kLargeResidual:
      return "large_residual";
    case SensorCode::kLabelsDisagree:
      return "labels_disagree";
    case SensorCode::kUncertain:
      return "uncertain";
  }
  return "";
}

}  // namespace volalign
