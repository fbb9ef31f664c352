#include "infer/checks/verification.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "infer/checks/hints.h"
#include "infer/initial/sides_fix_pose.h"

namespace volalign {

namespace {

/// Least mean probability of a side's labels of which the network is sure.
constexpr double kSureConfidence = 0.8;
/// Least area of such sides, m^2, that shows a structure in a frame without a pose.
constexpr double kLeastSureArea = 0.05;
/// From so many such sides and this area, m^2, on, the stack or the intrinsics explain a misfit,
/// not other things in the room. A stack seen from one corner shows over 1.
constexpr std::size_t kManySides = 4;
constexpr double kManySidesArea = 0.5;

std::string CountSides(std::size_t count) {
  return fmt::format("{} side{}", count, count == 1 ? " was" : "s were");
}

/// Are the odds of a wrong pose to the right one decisive?
bool Refutes(double log_odds) { return -log_odds >= std::log(kDecisiveOdds); }

/// Explains why a pose does not explain the view.
Finding ExplainMisfit(const LocateFacts& facts) {
  const ViewExplanation& view = facts.explanation;
  std::string shares = fmt::format(
      "at the best pose the sensor looks through {:.0f} % of the places where boxes should be",
      100 * view.behind_share());
  if (view.has_labels()) {
    shares += fmt::format(", and {:.0f} % of the labelled pixels lie on their side",
                          100 * view.named_so_share());
  }
  const bool nothing_fits = Refutes(view.LogOddsByDepth()) && Refutes(view.LogOddsByLabels());
  if (SeesManySides(facts.initial->patches) && !nothing_fits) {
    return {SensorCode::kInconsistent,
            "the sides that were found do not fit the structure: " + shares,
            "check that the boxes are stacked as the structure file says, then the intrinsics and "
            "depth_scale"};
  }
  return {SensorCode::kNoStructure, "the structure was not found: " + shares, kLookHint};
}

}  // namespace

SureSides CountSureSides(const std::vector<SidePatch>& patches) {
  SureSides sure;
  for (const SidePatch& patch : patches) {
    if (patch.mean_confidence < kSureConfidence) continue;
    sure.area += patch.area;
    ++sure.count;
  }
  return sure;
}

bool SeesManySides(const std::vector<SidePatch>& patches) {
  const SureSides sure = CountSureSides(patches);
  return sure.count >= kManySides && sure.area > kManySidesArea;
}

Finding ExplainMissingPose(const InitialPose& initial) {
  if (CountSureSides(initial.patches).area < kLeastSureArea)
    return {SensorCode::kNoStructure, "no side of the structure was found", kLookHint};
  return {
      SensorCode::kDegenerateSides,
      fmt::format("{} found; that does not determine a pose", CountSides(initial.patches.size())),
      kLookHint};
}

Finding ExplainMissingShape() {
  return {SensorCode::kNoStructure,
          "the structure was not found: nothing in the view has its shape",
          "let it see two boxes or more and the floor round them. Check that the boxes are stacked "
          "as the structure file says and that the frame is not mirrored. Then check its "
          "intrinsics and depth_scale"};
}

bool IsRefuted(const ViewExplanation& explanation) {
  const double by_depth = explanation.LogOddsByDepth();
  return Refutes(by_depth) ||
         (explanation.has_labels() && by_depth + explanation.LogOddsByLabels() < 0);
}

std::optional<Finding> VerifyOwnPose(const LocateFacts& facts, const Structure& structure,
                                     const VerdictOptions& options) {
  if (IsRefuted(facts.explanation)) return ExplainMisfit(facts);
  if (!SidesFixPose(structure, facts.confirmed)) {
    return Finding{SensorCode::kDegenerateSides,
                   fmt::format("{} found. They leave the pose free in one direction",
                               CountSides(facts.confirmed.size())),
                   kLookHint};
  }
  if (!(facts.sigma_position_m <= options.max_sigma_position_m)) {
    return Finding{SensorCode::kDegenerateSides,
                   fmt::format("{} found. They determine the sensor's position only to {:.2f} m",
                               CountSides(facts.confirmed.size()), facts.sigma_position_m),
                   kLookHint};
  }
  return std::nullopt;
}

}  // namespace volalign
