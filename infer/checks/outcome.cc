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

std::vector<SensorStatus> AllOf(SensorStatus) {
  return {SensorStatus::kOk, SensorStatus::kWeak, SensorStatus::kFailed};
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
    case SensorCode::kFrameMirrored:
      return "frame_mirrored";
    case SensorCode::kUnconnected:
      return "unconnected";
    case SensorCode::kDuplicateDepth:
      return "duplicate_depth";
    case SensorCode::kIntrinsicsSuspect:
      return "intrinsics_suspect";
    case SensorCode::kNotFinite:
      return "not_finite";
    case SensorCode::kUnsolved:
      return "unsolved";
    case SensorCode::kDisagrees:
      return "disagrees";
    case SensorCode::kSamePose:
      return "same_pose";
    case SensorCode::kAmbiguous:
      return "ambiguous";
    case SensorCode::kByNeighbours:
      return "by_neighbours";
    case SensorCode::kFewInliers:
      return "few_inliers";
    case SensorCode::kLargeResidual:
      return "large_residual";
    case SensorCode::kLabelsDisagree:
      return "labels_disagree";
    case SensorCode::kLensSuspect:
      return "lens_suspect";
    case SensorCode::kUncertain:
      return "uncertain";
  }
  return "";
}

std::vector<SensorCode> AllOf(SensorCode) {
  std::vector<SensorCode> codes;
  for (int code = 0; code <= static_cast<int>(SensorCode::kUncertain); ++code) {
    codes.push_back(static_cast<SensorCode>(code));
  }
  return codes;
}

}  // namespace volalign
