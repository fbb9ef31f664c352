#include "infer/checks/verdict.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <cstddef>
#include <limits>

namespace volalign {

namespace {

double LargestSigma(const Eigen::Matrix3d& covariance) {
  if (!covariance.allFinite()) return std::numeric_limits<double>::quiet_NaN();
  return std::sqrt(
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance, Eigen::EigenvaluesOnly)
          .eigenvalues()
          .maxCoeff());
}

}  // namespace

Eigen::Vector3d SigmaTranslation(const Matrix6d& covariance) {
  return covariance.diagonal().head<3>().cwiseSqrt();
}

Eigen::Vector3d SigmaRotationDeg(const Matrix6d& covariance) {
  return covariance.diagonal().tail<3>().cwiseSqrt() / kDegree;
}

Eigen::Matrix3d PositionCovariance(const Pose& structure_from_sensor, const Matrix6d& covariance) {
  Eigen::Matrix<double, 3, 6> jacobian;
  jacobian << Eigen::Matrix3d::Identity(), -Cross(structure_from_sensor.translation());
  return jacobian * covariance * jacobian.transpose();
}

Eigen::Vector3d SigmaPosition(const Pose& structure_from_sensor, const Matrix6d& covariance) {
  return PositionCovariance(structure_from_sensor, covariance).diagonal().cwiseSqrt();
}

double LargestSigmaPosition(const Pose& structure_from_sensor, const Matrix6d& covariance) {
  return LargestSigma(PositionCovariance(structure_from_sensor, covariance));
}

double LargestSigmaRotationDeg(const Matrix6d& covariance) {
  return LargestSigma(covariance.bottomRightCorner<3, 3>()) / kDegree;
}

std::string FormatOdds(double log_odds) {
  constexpr double kMost = 1000;
  const double odds = std::exp(std::abs(log_odds));
  const std::string times = odds > kMost ? fmt::format("over {:.0f}", kMost)
                            : odds < 10  ? fmt::format("{:.1f}", odds)
                                         : fmt::format("{:.0f}", odds);
  return log_odds < 0 ? "1 : " + times : times + " : 1";
}

std::optional<Finding> FindWeakness(const VerdictFacts& facts, const VerdictOptions& options) {
  if (!facts.unsolved.empty()) {
    return Finding{SensorCode::kUnsolved, facts.unsolved,
                   "check the depths and intrinsics of this sensor and of its neighbours, and the "
                   "prior standard deviations (refine.*_sigma_*)"};
  }
  if (!facts.same_depth_as.empty()) {
    return Finding{SensorCode::kDuplicateDepth,
                   fmt::format("{} has the same depth map", facts.same_depth_as),
                   "check which of the two it belongs to"};
  }
  if (facts.suspect_lens) return facts.suspect_lens;
  if (!facts.other_pose.empty()) {
    const std::string fits = fmt::format("its view fits the structure about as well {} (odds {})",
                                         facts.other_pose, FormatOdds(facts.log_odds));
    const std::string choose =
        ". Or compare both poses in report.html, and choose the other one with --choose SENSOR=2";
    if (!facts.floor_would_tell) {
      return Finding{
          SensorCode::kAmbiguous, fits,
          "let it see more of the structure, or stack the boxes so that they look different from "
          "every side" +
              choose};
    }
    return Finding{SensorCode::kAmbiguous, fits + ". It shows no floor, which would decide",
                   (facts.known_turns
                        ? "let it see the floor under the structure"
                        : "let it see the floor under the structure, or give its quarter_turns") +
                       choose};
  }
  if (facts.free_space_violation) {
    return Finding{
        SensorCode::kAmbiguous,
        fmt::format("it and {} cannot both be right: one of the two looks through {:.0f} % of the "
                    "points that the other measured beside the structure (odds {})",
                    facts.free_space_violation->name, 100 * facts.free_space_violation->share,
                    FormatOdds(facts.free_space_violation->log_odds)),
        "compare the pictures in report.html with where the sensors stand, and choose another pose "
        "with --choose SENSOR=2. Or let both see more of the stack and the floor under it"};
  }
  if (facts.contradiction) {
    return Finding{
        SensorCode::kDisagrees,
        fmt::format("it contradicts the other sensors, as its pairs with {} show: they would move "
                    "it by {:.1f} mm and {:.2f} deg. The pose given is from its own picture only. "
                    "The other sensors' poses do not use this sensor",
                    fmt::join(facts.contradiction->names, ", "),
                    1000 * facts.contradiction->apart.translation_m,
                    facts.contradiction->apart.rotation_deg),
        "check that its frame is not mirrored or turned by 180 deg, and that its depth file is not "
        "another sensor's. Then check its intrinsics, and that no box moved between the frames"};
  }
  if (!facts.unsettled.empty()) {
    return Finding{SensorCode::kUnsettled,
                   fmt::format("the joint solution has not settled: {}", facts.unsettled),
                   "let the sensors see more of the stack"};
  }
  const PoseQuality& quality = facts.quality;
  if (quality.inlier_share < options.weak_inlier_share) {
    return Finding{SensorCode::kFewInliers,
                   fmt::format("only {:.0f} % of the labelled pixels lie on the structure. Either "
                               "something else stands there, or a box is not as described",
                               100 * quality.inlier_share),
                   "look at pictures/ for what else was labelled. Clear it away, or correct the "
                   "structure file"};
  }
  if (quality.rms_to_structure_m > options.weak_rms_m) {
    return Finding{SensorCode::kLargeResidual,
                   fmt::format("points are {:.1f} mm RMS off the structure",
                               1000 * quality.rms_to_structure_m),
                   "check the boxes' dimensions and placement, the intrinsics and the depth_scale"};
  }
  if (quality.label_iou < options.weak_label_iou) {
    return Finding{
        SensorCode::kLabelsDisagree,
        fmt::format(
            "the labels that were found and those that the pose predicts overlap by only {:.0f} %",
            100 * quality.label_iou),
        "look at pictures/: something may hide the structure, or the sensor may be too near or too "
        "far"};
  }
  const double sigma_m = LargestSigmaPosition(facts.structure_from_sensor, facts.covariance);
  const double sigma_deg = LargestSigmaRotationDeg(facts.covariance);
  if (!(sigma_m <= options.weak_sigma_position_m) ||
      !(sigma_deg <= options.weak_sigma_rotation_deg)) {
    return Finding{
        SensorCode::kUncertain,
        fmt::format("the pose is uncertain: {:.1f} mm and {:.2f} deg (one standard deviation)",
                    1000 * sigma_m, sigma_deg),
        "let it see more sides, or more of what its neighbours see"};
  }
  if (facts.shape_log_odds && *facts.shape_log_odds < std::log(kDecisiveOdds)) {
    return Finding{SensorCode::kAmbiguous,
                   fmt::format("by their shape, the odds are only {} that it sees the structure "
                               "and not something else. Do not rely on this pose",
                               FormatOdds(*facts.shape_log_odds)),
                   "look at pictures/ for what it sees. Clear its view, or calibrate with a model"};
  }
  return std::nullopt;
}

std::vector<std::optional<Finding>> FindDuplicates(const std::vector<std::string>& names,
                                                   const std::vector<std::optional<Pose>>& poses) {
  constexpr double kSameDirectionDeg = 2;  // between sensors that are one
  std::vector<std::optional<Finding>> duplicates(poses.size());
  for (std::size_t i = 0; i < poses.size(); ++i) {
    for (std::size_t j = 0; j < poses.size(); ++j) {
      if (i == j || !poses[i] || !poses[j]) continue;
      const PoseError gap = ComparePoses(*poses[i], *poses[j]);
      if (gap.translation_m > kSamePlace || gap.rotation_deg > kSameDirectionDeg) continue;
      duplicates[i] =
          Finding{SensorCode::kSamePose,
                  fmt::format("it stands where {} stands, within {:.1f} mm and {:.2f} deg",
                              names[j], 1000 * gap.translation_m, gap.rotation_deg),
                  "check the sensors' depth files: one sensor seems to be given twice"};
    }
  }
  return duplicates;
}

}  // namespace volalign
