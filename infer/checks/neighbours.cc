#include "infer/checks/neighbours.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>

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

/// A located frame of the same capture.
struct Neighbour {
  FrameId id;
  const std::string* name;
  const SensorView* view;
  FrameInput sensor;
};

/// The frame to be located.
struct Lost {
  const SensorView& view;
  const Labelled& labelled;
  std::shared_ptr<const SensorPoints> points;  // as `labelled` has them
  const std::vector<SensorLens>& lenses;
  int lens;  // its own, of these
};

/// How many of `probes` points of a sensor at a pose lie on a neighbour's points, to kStep.
int CountShared(const Lost& lost, const std::vector<Neighbour>& neighbours, const Pose& pose,
                std::size_t probes) {
  int shared = 0;
  for (const CloudPoint& point : Thinned(lost.points->cloud.points(), probes)) {
    const bool found =
        std::any_of(neighbours.begin(), neighbours.end(), [&](const Neighbour& neighbour) {
          const SampledCloud& cloud = neighbour.sensor.points->cloud;
          const Pose there = neighbour.sensor.start.inverse() * pose;
          const int nearest = cloud.Nearest(there * point.p, kStep);
          return nearest >= 0 &&
                 (there.linear() * point.normal)
                         .dot(cloud.points()[static_cast<std::size_t>(nearest)].normal) >
                     kFacesAlike;
        });
    shared += found ? 1 : 0;
  }
  return shared;
}

/// LogOddsOfPairs of a sensor at a pose, by its neighbours' points beside the structure.
double LogOddsBeside(const Lost& lost, const std::vector<Neighbour>& neighbours, const Pose& pose,
                     const Structure& structure) {
  const MeasuredView own(lost.view, structure, {pose});
  CauseShares all = {};
  for (const Neighbour& neighbour : neighbours) {
    const MeasuredView other(*neighbour.view, structure, {neighbour.sensor.start});
    const CauseShares pair =
        ExplainPair(own, other, pose.inverse() * neighbour.sensor.start, kRoughPose);
    for (std::size_t cause = 0; cause < kCauses; ++cause) all[cause] += pair[cause];
  }
  return LogOddsOfPairs(all);
}

/// The structure's vertical in the sensors' frames, which are mounted alike.
Eigen::Vector3d UpOf(const std::vector<Neighbour>& neighbours) {
  Eigen::Vector3d up = Eigen::Vector3d::Zero();
  for (const Neighbour& neighbour : neighbours)
    up += neighbour.sensor.start.linear().transpose() * Eigen::Vector3d::UnitY();
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

/// The initial pose, and one from each of the largest upright sides alone.
std::vector<Pose> StartPoses(const Lost& lost, const std::vector<Neighbour>& neighbours,
                             const Structure& structure) {
  std::vector<Pose> starts;
  if (lost.labelled.initial.found) starts.push_back(lost.labelled.initial.structure_from_sensor);
  std::vector<SidePatch> sides = lost.labelled.initial.patches;
  KeepLargest(kMostSides, &sides, [](const SidePatch& side) { return side.area; });
  for (const SidePatch& side : sides) {
    const Eigen::Vector3d& normal = structure.SideOfLabel(side.label).normal;
    if (std::abs(normal.y()) > kUpright) continue;
    Pose pose = Pose::Identity();
    pose.linear() = FrameOf(normal, Eigen::Vector3d::UnitY()) *
                    FrameOf(side.normal, UpOf(neighbours)).transpose();
    pose.translation() =
        structure.Keypoint(side.label, KeypointKind::kExposed) - pose.linear() * side.centroid;
    if (pose.matrix().allFinite()) starts.push_back(pose);
  }
  return starts;
}

/// Directions, structure frame, that the found sides leave open.
std::vector<Eigen::Vector3d> OpenDirections(const std::vector<SidePatch>& sides,
                                            const Structure& structure) {
  Eigen::Matrix3d normals = Eigen::Matrix3d::Zero();
  for (const SidePatch& side : sides) {
    const Eigen::Vector3d& normal = structure.SideOfLabel(side.label).normal;
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

struct Candidate {
  Pose pose;
  int shared;  // CountShared
};

/// The best ones, none next to a better one.
std::vector<Candidate> BestApart(std::vector<Candidate> all) {
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

std::vector<Candidate> Search(const Lost& lost, const std::vector<Neighbour>& neighbours,
                              const Structure& structure) {
  const std::vector<Eigen::Vector3d> open =
      OpenDirections(lost.labelled.initial.patches, structure);
  const int steps = static_cast<int>(std::lround(kReach / kStep));
  const int across = open.size() > 1 ? steps : 0, along = open.empty() ? 0 : steps;
  std::vector<Candidate> candidates;
  for (const Pose& start : StartPoses(lost, neighbours, structure)) {
    for (int i = -along; i <= along; ++i) {
      for (int j = -across; j <= across; ++j) {
        Pose pose = start;
        if (along > 0) pose.translation() += i * kStep * open[0];
        if (across > 0) pose.translation() += j * kStep * open[1];
        candidates.push_back({pose, CountShared(lost, neighbours, pose, kFewProbes)});
      }
    }
  }
  return BestApart(std::move(candidates));
}

/// A candidate that was refined with the placed sensors.
struct Refined {
  Pose pose = Pose::Identity();
  double sigma_position_m = 0;  // LargestSigmaPosition
};

/// Nothing where it does not meet all conditions. Its neighbours' points alone support its pose, so
/// they have to speak for it.
std::optional<Refined> RefineWith(const Lost& lost, const std::vector<Neighbour>& neighbours,
                                  const Pose& start, const Structure& structure,
                                  const LocateOptions& options) {
  std::vector<FrameInput> sensors;
  sensors.reserve(neighbours.size() + 1);
  for (const Neighbour& neighbour : neighbours) sensors.push_back(neighbour.sensor);
  sensors.push_back({lost.points, start, lost.lens});
  RefineSetup together(options.refine);
  together.free = EstimateSet();
  together.free.scale_priors = false;
  const RefinedFrame found = Refine(structure, sensors, together, lost.lenses).frames.back();

  const Refined refined{found.structure_from_sensor,
                        LargestSigmaPosition(found.structure_from_sensor, found.covariance)};
  const bool explains =
      !IsRefuted(ExplainView(lost.view, lost.labelled.ByNetwork(), structure, refined.pose,
                             options.refine.box_sigma_m, kLeastConfidence));
  const bool fixed = refined.sigma_position_m <= kRoughPose &&
                     LargestSigmaRotationDeg(found.covariance) <= kMostSigmaDeg;
  if (!found.solved || !found.problem.empty() || !explains || !fixed ||
      !(LogOddsBeside(lost, neighbours, refined.pose, structure) > 0))
    return std::nullopt;
  return refined;
}

/// The one pose that meets all conditions, if there is one and no other.
std::optional<Refined> FindPose(const Lost& lost, const std::vector<Neighbour>& neighbours,
                                const Structure& structure, const LocateOptions& options) {
  std::optional<Refined> found;
  for (const Candidate& candidate : Search(lost, neighbours, structure)) {
    const std::optional<Refined> refined =
        RefineWith(lost, neighbours, candidate.pose, structure, options);
    if (!refined) continue;
    if (found && (refined->pose.translation() - found->pose.translation()).norm() > kStep)
      return std::nullopt;
    if (!found) found = refined;
  }
  return found;
}

/// Neighbours that share points with it at the pose, the one with most first.
std::vector<FrameId> RestsOn(const Lost& lost, const std::vector<Neighbour>& neighbours,
                             const Pose& pose) {
  std::vector<std::pair<int, FrameId>> shared;
  for (const Neighbour& neighbour : neighbours) {
    const int count = CountShared(lost, {neighbour}, pose, kManyProbes);
    if (count > 0) shared.emplace_back(count, neighbour.id);
  }
  SortLargestFirst(&shared, [](const auto& each) { return each.first; });
  std::vector<FrameId> ids;
  for (const auto& [count, id] : shared) ids.push_back(id);
  return ids;
}

/// The names of the ambiguous ones.
std::string InDoubt(const Seen& seen, const std::vector<FrameId>& ids) {
  std::string names;
  for (const FrameId id : ids) {
    if (!seen.labelled[id].other_pose.empty())
      names += (names.empty() ? "" : ", ") + (*seen.capture)[id].name;
  }
  return names;
}

std::string NamesOf(const std::vector<Neighbour>& neighbours) {
  std::string names;
  for (const Neighbour& neighbour : neighbours)
    names += (names.empty() ? "" : ", ") + *neighbour.name;
  return names;
}

/// Located frames of one capture, refined in the frame of its stack.
std::vector<Neighbour> NeighboursIn(const Seen& seen, std::size_t still,
                                    const SomeFrames<FrameInput>& located) {
  std::vector<Neighbour> neighbours;
  for (const auto& [id, frame] : located) {
    if (id.still != still) continue;
    neighbours.push_back({id, &(*seen.capture)[id].name, &seen.views[id], frame});
    neighbours.back().sensor.still = 0;
  }
  return neighbours;
}

}  // namespace

PerFrame<LocateResult> LocateByNeighbours(const Seen& seen, PerFrame<LocateResult> results,
                                          const LocateOptions& options) {
  if (options.refine.max_overlap_points == 0) return results;
  const Structure& structure = seen.capture->structure;
  const SomeFrames<FrameInput> located = FramesToRefine(seen, results);
  for (const FrameId id : results.Ids()) {
    const auto* failure = std::get_if<Finding>(&results[id]);
    if (!failure || failure->code != SensorCode::kDegenerateSides) continue;
    const std::vector<Neighbour> neighbours = NeighboursIn(seen, id.still, located);
    if (neighbours.empty()) continue;
    const Labelled& labelled = seen.labelled[id];
    const Lost lost{seen.views[id], labelled, PointsOf(seen, id, labelled.segmentation, options),
                    seen.lenses.lenses, static_cast<int>(seen.lenses.of_frame[id])};
    const std::optional<Refined> found = FindPose(lost, neighbours, structure, options);
    if (!found) continue;
    LocatedFrame frame;
    frame.own_pose = found->pose;
    frame.points = PointsAt(seen, id, structure, found->pose, options);
    frame.by_neighbours = Finding{
        SensorCode::kByNeighbours,
        fmt::format(
            "{0}. So its pose, known to {2:.0f} mm, comes from what it sees in common with {1}",
            failure->reason, NamesOf(neighbours), 1000 * found->sigma_position_m),
        failure->hint};
    frame.rests_on = RestsOn(lost, neighbours, found->pose);
    if (const std::string in_doubt = InDoubt(seen, frame.rests_on); !in_doubt.empty()) {
      frame.by_neighbours->code = SensorCode::kAmbiguous;
      frame.by_neighbours->reason +=
          fmt::format(". If {} has another pose, so has this sensor", in_doubt);
    }
    results[id] = std::move(frame);
  }
  return results;
}

}  // namespace volalign
