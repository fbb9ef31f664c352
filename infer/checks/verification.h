#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "core/geometry/structure.h"
#include "infer/checks/intrinsics_check.h"
#include "infer/checks/outcome.h"
#include "infer/checks/verdict.h"
#include "infer/depth/explain_view.h"
#include "infer/initial/initial_pose.h"
#include "infer/initial/side_patch.h"

namespace volalign {

/// Error of the intrinsics, in focal lengths, from which on a pose is decimetres off.
inline constexpr double kFarOffIntrinsics = 0.08;

/// Sides that the network is sure of.
struct SureSides {
  std::size_t count = 0;
  double area = 0;  ///< m^2
};
SureSides CountSureSides(const std::vector<SidePatch>& patches);

/// Enough of what looks like sides to ask why they do not fit.
bool SeesManySides(const std::vector<SidePatch>& patches);

/// Why a frame without an initial pose has none: one or two sides that the network is sure of are a
/// structure seen too narrowly (degenerate_sides), less is none (no_structure).
Finding ExplainMissingPose(const InitialPose& initial);

/// Why a frame without a network's labels has no initial pose.
Finding ExplainMissingShape();

/// What a sensor's own pose is verified by.
struct LocateFacts {
  ViewExplanation explanation;  ///< at the own pose
  std::vector<int> confirmed;   ///< ConfirmedLabels at the own pose
  double sigma_position_m = 0;  ///< LargestSigmaPosition of the own pose
  const InitialPose* initial = nullptr;
  const BetterIntrinsics* better_intrinsics = nullptr;  ///< null: none fit better
};

/// Would a wrong pose explain the depths of a view so much better than this one does, or depths and
/// labels together better at all? Depths refute it alone: labels that fit do not outweigh that a
/// sensor sees through the structure.
bool IsRefuted(const ViewExplanation& explanation);

/// Nothing if what the sensor saw is consistent with its own pose, or why the sensor is not placed.
std::optional<Finding> VerifyOwnPose(const LocateFacts& facts, const Structure& structure,
                                     const VerdictOptions& options);

/// intrinsics_suspect, with what would fit better.
Finding SuspectIntrinsics(const BetterIntrinsics& better);

}  // namespace volalign
