#include "infer/checks/prior_use.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <variant>

#include "core/base/odds.h"
#include "infer/checks/verdict.h"
#include "infer/initial/pose_priors.h"

namespace volalign {

namespace {

/// Covariance of the difference of a pose from its prior, as of PerturbLeft.
Matrix6d CovarianceOf(const PosePrior& prior, const Pose& pose) {
  Matrix6d by_sensor = Matrix6d::Identity();  // of v by the sensor's movement and turn
  by_sensor.topRightCorner<3, 3>() = Cross(pose.translation());
  Vector6d variances;
  variances << Eigen::Vector3d::Constant(prior.sigma_m * prior.sigma_m),
      Eigen::Vector3d::Constant(std::pow(prior.sigma_deg * kDegree, 2));
  return by_sensor * variances.asDiagonal() * by_sensor.transpose();
}

/// Compares a prior that lies in the frame of the first capture with a frame's own pose there.
PlacedPrior Compare(PosePrior prior, const Pose& pose, const Matrix6d& covariance) {
  PlacedPrior placed;
  placed.difference = LeftDifference(prior.world_from_sensor, pose);
  const Matrix6d both = covariance + CovarianceOf(prior, pose);
  placed.misfit = placed.difference.dot(both.ldlt().solve(placed.difference)) / 2;
  placed.prior = std::move(prior);
  placed.used = !(placed.Chance() < 1 / kUnusualOdds);
  return placed;
}

struct PlacedFrame {
  FrameId id;
  PosePrior prior;
  Pose first_from_sensor;
  Matrix6d covariance;
};

/// The prior if the structure may stand anywhere in its world.
PosePrior Anywhere(PosePrior prior) {
  if (prior.world == PriorWorld::kStructure) prior.world = PriorWorld::kMetric;
  return prior;
}

/// `anywhere`: the structure may stand anywhere in the priors' world.
SomeFrames<PlacedPrior> CompareAll(const std::vector<PlacedFrame>& frames, bool anywhere) {
  std::vector<PosePrior> priors;
  std::vector<std::vector<Pose>> poses;
  for (const PlacedFrame& frame : frames) {
    priors.push_back(anywhere ? Anywhere(frame.prior) : frame.prior);
    poses.push_back({frame.first_from_sensor});
  }
  std::vector<const PosePrior*> given;
  for (const PosePrior& prior : priors) given.push_back(&prior);
  const std::vector<WorldPlacement> worlds = FindWorlds(given, poses);
  SomeFrames<PlacedPrior> placed;
  if (worlds.empty()) return placed;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    PosePrior prior = frames[k].prior;
    prior.world_from_sensor = worlds.front().Place(prior.world_from_sensor);
    placed[frames[k].id] =
        Compare(std::move(prior), frames[k].first_from_sensor, frames[k].covariance);
  }
  return placed;
}

std::vector<PlacedFrame> FramesWithPriors(const Seen& seen, const PerFrame<LocateResult>& results,
                                          const std::vector<Pose>& first_from_stack) {
  std::vector<PlacedFrame> frames;
  for (const FrameId id : results.Ids()) {
    const auto* located = std::get_if<LocatedFrame>(&results[id]);
    const std::optional<PosePrior>& prior = (*seen.input)[id].prior;
    if (!located || !prior) continue;
    const Pose& placement = first_from_stack[id.capture];
    const Matrix6d turned = Adjoint(placement);
    frames.push_back({id, *prior, placement * located->own_pose,
                      turned * located->covariance * turned.transpose()});
  }
  return frames;
}

/// How far `from` is from the pose that `difference` makes of it.
std::string DescribeDifference(const Pose& from, const Vector6d& difference) {
  const Pose to = PerturbLeft(difference, from);
  const Eigen::Vector3d moved = from.translation() - to.translation();
  return fmt::format(
      "{:.2f} m ({:+.2f}, {:+.2f}, {:+.2f} along the structure's x, y, z) and "
      "{:.1f} deg",
      moved.norm(), moved.x(), moved.y(), moved.z(), ComparePoses(from, to).rotation_deg);
}

}  // namespace

double PlacedPrior::Chance() const {
  // Of chi-square with six degrees of freedom, in closed form.
  return std::exp(-misfit) * (1 + misfit + misfit * misfit / 2);
}

std::vector<std::optional<PosePrior>> PriorsOfCapture(const CaptureSet& input,
                                                      std::size_t capture) {
  std::vector<std::optional<PosePrior>> priors;
  for (const SensorFrame& frame : input.captures[capture].frames) {
    priors.push_back(frame.prior);
    if (capture > 0 && priors.back()) priors.back() = Anywhere(*priors.back());
  }
  return priors;
}

SomeFrames<PlacedPrior> PlacePriors(const Seen& seen, const PerFrame<LocateResult>& results,
                                    const std::vector<Pose>& first_from_stack) {
  return CompareAll(FramesWithPriors(seen, results, first_from_stack), false);
}

std::vector<RigFinding> ExplainPriors(const Seen& seen, const PerFrame<LocateResult>& results,
                                      const std::vector<Pose>& first_from_stack) {
  const CaptureSet& input = *seen.input;
  const SomeFrames<PlacedPrior> priors = PlacePriors(seen, results, first_from_stack);
  std::vector<RigFinding> findings;
  for (const auto& [id, placed] : priors) {
    const std::string& name = input[id].name;
    const bool known = std::any_of(findings.begin(), findings.end(), [&](const RigFinding& each) {
      return each.about.front() == name;
    });
    if (placed.used || known) continue;
    findings.push_back(
        {RigCode::kPriorOff,
         {name},
         fmt::format("the prior of {} is {} from the pose that the frames show, with odds of {} "
                     "against the prior. The pose does not use it",
                     name, DescribeDifference(placed.prior.world_from_sensor, placed.difference),
                     FormatOdds(placed.misfit)),
         "measure again where the sensor stands, or leave the prior out"});
  }
  const bool in_structure =
      !priors.empty() && priors.begin()->second.prior.world == PriorWorld::kStructure;
  if (!in_structure || findings.size() < 2 || 2 * findings.size() <= priors.size()) return findings;
  const SomeFrames<PlacedPrior> moved =
      CompareAll(FramesWithPriors(seen, results, first_from_stack), true);
  const auto agree =
      std::count_if(moved.begin(), moved.end(), [](const auto& each) { return each.second.used; });
  if (2 * static_cast<std::size_t>(agree) <= moved.size()) return findings;
  const auto& [id, placed] = *moved.begin();
  const Pose motion = placed.prior.world_from_sensor * input[id].prior->world_from_sensor.inverse();
  return {{RigCode::kPriorOff,
           {},
           fmt::format("{} of {} priors agree with each other, but the structure stands {} from "
                       "its place in their frame. The poses do not use them",
                       agree, moved.size(),
                       DescribeDifference(motion, LeftDifference(motion, Pose::Identity()))),
           "put the structure at that place. Or give the priors as world_from_sensor: the place of "
           "the structure is then estimated"}};
}

}  // namespace volalign
