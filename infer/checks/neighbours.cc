#include "infer/checks/neighbours.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/base/lists.h"
#include "infer/checks/verification.h"
#include "infer/depth/measured_view.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

/// Standard deviation of a rotation, deg, above which overlap does not fix it; of a position it is
/// kRoughPose.
constexpr double kMostSigmaDeg = 2;

constexpr double kReach = 0.6, kStep = 0.1;  // m, of the search along an open direction
/// Share of the largest eigenvalue of the sides' normals below which a direction is open.
constexpr double kOpen = 0.05;
constexpr std::size_t kMostSides = 2;  // each gives a start
constexpr double kUpright = 0.5;       // cosine: flatter sides do not fix the sensor's turn

/// The structure's vertical in the sensors' frames, which are mounted alike.
Eigen::Vector3d UpOf(const SomeFrames<FrameInput>& neighbours) {
  Eigen::Vector3d up = Eigen::Vector3d::Zero();
  for (const auto& [id, sensor] : neighbours)
    up += sensor.start.linear().transpose() * Eigen::Vector3d::UnitY();
  return up;
}

/// Columns: a unit normal, the part of the vertical at a right angle to it, and their cross
/// product.
Eigen::Matrix3d FrameOf(const Eigen::Vector3d& normal, const Eigen::Vector3d& up) {
  Eigen::Matrix3d frame;
  frame.col(0) = normal;
  frame.col(1) = (up - normal * normal.dot(up)).normalized();
  frame.col(2) = frame.col(0).cross(frame.col(1));
  return frame;
}

/// A pose of the frame that is to be located.
struct Candidate {
  Pose pose = Pose::Identity();
  int shared = 0;               // points on neighbours' points
  double sigma_position_m = 0;  // LargestSigmaPosition, once it is refined
};

/// The search for the pose of one frame, beside the located ones of its capture.
class Search {
 public:
  Search(const Seen& seen, FrameId lost, const SomeFrames<FrameInput>& neighbours,
         const LocateOptions& options)
      : seen_(seen),
        lost_(lost),
        neighbours_(neighbours),
        options_(options),
        structure_(seen.input->structure),
        labelled_(seen.labelled[lost]),
        points_(PointsOf(seen, lost, labelled_.segmentation, options)) {}

  /// The one pose that meets all conditions, if there is one and no other.
  std::optional<Candidate> Find() const {
    std::optional<Candidate> found;
    for (const Candidate& start : Starts()) {
      const std::optional<Candidate> refined = Refined(start.pose);
      if (!refined) continue;
      if (found && (refined->pose.translation() - found->pose.translation()).norm() > kStep)
        return std::nullopt;
      if (!found) found = refined;
    }
    return found;
  }

  /// Neighbours that share points with it at the pose, the one with most first.
  std::vector<FrameId> RestsOn(const Pose& pose) const {
    std::vector<std::pair<int, FrameId>> shared;
    for (const auto& neighbour : neighbours_) {
      const int count = CountShared(pose, {neighbour}, kManyProbes);
      if (count > 0) shared.emplace_back(count, neighbour.first);
    }
    SortLargestFirst(&shared, [](const auto& each) { return each.first; });
    std::vector<FrameId> ids;
    for (const auto& [count, id] : shared) ids.push_back(id);
    return ids;
  }

 private:
  /// How many of `probes` points at a pose lie on points of one of `others`, to kStep.
  int CountShared(const Pose& pose, const SomeFrames<FrameInput>& others,
                  std::size_t probes) const {
    int shared = 0;
    for (const CloudPoint& point : Thinned(points_->cloud.points(), probes)) {
      shared += std::any_of(others.begin(), others.end(), [&](const auto& neighbour) {
        const SampledCloud& cloud = neighbour.second.points->cloud;
        const Pose there = neighbour.second.start.inverse() * pose;
        const int nearest = cloud.Nearest(there * point.p, kStep);
        return nearest >= 0 &&
               (there.linear() * point.normal)
                       .dot(cloud.points()[static_cast<std::size_t>(nearest)].normal) > kFacesAlike;
      });
    }
    return shared;
  }

  /// LogOddsOfPairs at a pose, by the neighbours' points beside the structure.
  double LogOddsBeside(const Pose& pose) const {
    const MeasuredView own(seen_.views[lost_], structure_, {pose});
    CauseShares all = {};
    for (const auto& [id, sensor] : neighbours_) {
      const MeasuredView other(seen_.views[id], structure_, {sensor.start});
      const CauseShares pair = ExplainPair(own, other, pose.inverse() * sensor.start, kRoughPose);
      for (std::size_t cause = 0; cause < kCauses; ++cause) all[cause] += pair[cause];
    }
    return LogOddsOfPairs(all);
  }

  /// The initial pose, and one from each of the largest upright sides alone.
  std::vector<Pose> StartPoses() const {
    std::vector<Pose> starts;
    if (labelled_.initial.found) starts.push_back(labelled_.initial.structure_from_sensor);
    std::vector<SidePatch> sides = labelled_.initial.patches;
    KeepLargest(kMostSides, &sides, [](const SidePatch& side) { return side.area; });
    for (const SidePatch& side : sides) {
      const Eigen::Vector3d& normal = structure_.SideOfLabel(side.label).normal;
      if (std::abs(normal.y()) > kUpright) continue;
      Pose pose = Pose::Identity();
      pose.linear() = FrameOf(normal, Eigen::Vector3d::UnitY()) *
                      FrameOf(side.normal, UpOf(neighbours_)).transpose();
      pose.translation() =
          structure_.Keypoint(side.label, KeypointKind::kExposed) - pose.linear() * side.centroid;
      if (pose.matrix().allFinite()) starts.push_back(pose);
    }
    return starts;
  }

  /// Directions, structure frame, that the found sides leave open.
  std::vector<Eigen::Vector3d> OpenDirections() const {
    Eigen::Matrix3d normals = Eigen::Matrix3d::Zero();
    for (const SidePatch& side : labelled_.initial.patches) {
      const Eigen::Vector3d& normal = structure_.SideOfLabel(side.label).normal;
      normals += side.area * normal * normal.transpose();
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(normals);
    std::vector<Eigen::Vector3d> open;
    for (int k = 0; k < 3; ++k) {
      if (solver.eigenvalues()[k] <= kOpen * solver.eigenvalues()[2])
        open.push_back(solver.eigenvectors().col(k));
    }
    return open;
  }

  /// The poses along the open directions that share most, none next to a better one.
  std::vector<Candidate> Starts() const {
    const std::vector<Eigen::Vector3d> open = OpenDirections();
    const int steps = static_cast<int>(std::lround(kReach / kStep));
    const int across = open.size() > 1 ? steps : 0, along = open.empty() ? 0 : steps;
    std::vector<Candidate> all;
    for (const Pose& start : StartPoses()) {
      for (int i = -along; i <= along; ++i) {
        for (int j = -across; j <= across; ++j) {
          Pose pose = start;
          if (along > 0) pose.translation() += i * kStep * open[0];
          if (across > 0) pose.translation() += j * kStep * open[1];
          all.push_back({pose, CountShared(pose, neighbours_, kFewProbes)});
        }
      }
    }
    SortLargestFirst(&all, [](const Candidate& each) { return each.shared; });
    std::vector<Candidate> best;
    for (const Candidate& candidate : all) {
      if (best.size() == kBeam / 2) break;
      AddIfNew(candidate, &best, [&](const Candidate& other) {
        return (candidate.pose.translation() - other.pose.translation()).norm() < 2 * kStep;
      });
    }
    return best;
  }

  /// Refined with the neighbours. Nothing where it does not meet all conditions. Its neighbours'
  /// points alone support its pose, so they have to speak for it.
  std::optional<Candidate> Refined(const Pose& start) const {
    std::vector<FrameInput> sensors;
    for (const auto& [id, sensor] : neighbours_) sensors.push_back(sensor);
    sensors.push_back({points_, start, static_cast<int>(seen_.lenses.of_frame[lost_])});
    RefineSetup together(options_.refine);
    together.free = EstimateSet();
    together.free.scale_priors = false;
    const RefinedFrame found =
        Refine(structure_, sensors, together, seen_.lenses.lenses).frames.back();
    const Pose& pose = found.structure_from_sensor;
    const double sigma_position_m = LargestSigmaPosition(pose, found.covariance);
    const bool fixed = sigma_position_m <= kRoughPose &&
                       LargestSigmaRotationDeg(found.covariance) <= kMostSigmaDeg;
    if (!found.solved || !found.problem.empty() || !fixed ||
        IsRefuted(ExplainView(seen_.views[lost_], labelled_.ByNetwork(), structure_, pose,
                              options_.refine.box_sigma_m, kLeastConfidence)) ||
        !(LogOddsBeside(pose) > 0))
      return std::nullopt;
    return Candidate{pose, 0, sigma_position_m};
  }

  const Seen& seen_;
  FrameId lost_;
  const SomeFrames<FrameInput>& neighbours_;
  const LocateOptions& options_;
  const Structure& structure_;
  const Labelled& labelled_;
  std::shared_ptr<const SensorPoints> points_;  // as labelled_ has them
};

/// The frames of one capture, in the frame of its stack.
SomeFrames<FrameInput> OfCapture(std::size_t capture, const SomeFrames<FrameInput>& frames) {
  SomeFrames<FrameInput> of_capture;
  for (auto [id, frame] : frames) {
    if (id.capture != capture) continue;
    frame.capture = 0;
    of_capture[id] = frame;
  }
  return of_capture;
}

}  // namespace

PerFrame<LocateResult> LocateByNeighbours(const Seen& seen, PerFrame<LocateResult> results,
                                          const LocateOptions& options) {
  if (options.refine.max_overlap_points == 0) return results;
  const SomeFrames<FrameInput> located = FramesToRefine(seen, results);
  for (const FrameId id : results.Ids()) {
    const auto* failure = std::get_if<Finding>(&results[id]);
    if (!failure || failure->code != SensorCode::kDegenerateSides) continue;
    const SomeFrames<FrameInput> neighbours = OfCapture(id.capture, located);
    if (neighbours.empty()) continue;
    const Search search(seen, id, neighbours, options);
    const std::optional<Candidate> found = search.Find();
    if (!found) continue;
    std::vector<std::string> names, in_doubt;
    for (const auto& [other, sensor] : neighbours) names.push_back((*seen.input)[other].name);
    LocatedFrame frame;
    frame.own_pose = found->pose;
    frame.points = PointsAt(seen, id, seen.input->structure, found->pose, options);
    frame.by_neighbours = Finding{
        SensorCode::kByNeighbours,
        fmt::format(
            "{}. So its pose, known to {:.0f} mm, comes from what it sees in common with {}",
            failure->reason, 1000 * found->sigma_position_m, fmt::join(names, ", ")),
        failure->hint};
    frame.rests_on = search.RestsOn(found->pose);
    for (const FrameId other : frame.rests_on) {
      if (!seen.labelled[other].other_pose.empty()) in_doubt.push_back((*seen.input)[other].name);
    }
    if (!in_doubt.empty()) {
      frame.by_neighbours->code = SensorCode::kAmbiguous;
      frame.by_neighbours->reason +=
          fmt::format(". If {} has another pose, so has this sensor", fmt::join(in_doubt, ", "));
    }
    results[id] = std::move(frame);
  }
  return results;
}

}  // namespace volalign
