#include "infer/checks/outcome.h"

#include "core/config/config_word.h"

namespace volalign {

namespace {

constexpr Words<SensorStatus, 3> kStatuses = {
    {{"ok", SensorStatus::kOk}, {"weak", SensorStatus::kWeak}, {"failed", SensorStatus::kFailed}}};

constexpr Words<SensorCode, 29> kCodes = {{
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

}  // namespace

const char* ToString(SensorStatus status) { return WordOf(kStatuses, status); }

std::vector<SensorStatus> AllOf(SensorStatus) { return ValuesOf(kStatuses); }

const char* ToString(SensorCode code) { return WordOf(kCodes, code); }

std::vector<SensorCode> AllOf(SensorCode) { return ValuesOf(kCodes); }

}  // namespace volalign
