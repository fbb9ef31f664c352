#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "core/geometry/structure.h"
#include "infer/checks/outcome.h"
#include "infer/checks/verdict.h"
#include "infer/depth/explain_view.h"
#include "infer/initial/initial_pose.h"
#include "infer/initial/side_patch.h"

namespace volalign {

/// Sides that the network is sure of.
struct SureSides {
  std::size_t count = 0;
  double area = 0;  ///< m^2
};
SureSides CountSureSides(const std::vector<SidePatch>& patches);

/// Are there so many sides that a misfit needs a reason?
bool SeesManySides(const std::vector<SidePatch>& patches);

/// Explains a missing initial pose. One or two sides that the network is sure of mean a structure
/// seen too narrowly (degenerate_sides); less means no structure (no_structure).
Finding ExplainMissingPose(const InitialPose& initial);

/// Explains a missing initial pose of a frame without a network's labels.
Finding ExplainMissingShape();

/// Facts by which a sensor's own pose is verified.
struct LocateFacts {
  ViewExplanation explanation;  ///< at the own pose
  std::vector<int> confirmed;   ///< ConfirmedLabels at the own pose
  double sigma_position_m = 0;  ///< LargestSigmaPosition of the own pose
  const InitialPose* initial = nullptr;
};

/// Would a wrong pose explain the view's depths decisively better (kDecisiveOdds), or depths and
/// labels together better at all? Depths refute it alone: labels that fit do not outweigh that a
/// sensor sees through the structure.
bool IsRefuted(const ViewExplanation& explanation);

/// Nothing if the view is consistent with the sensor's own pose, else why the sensor is not placed.
std::optional<Finding> VerifyOwnPose(const LocateFacts& facts, const Structure& structure,
                                     const VerdictOptions& options);

}  // namespace volalign
