#include "infer/initial/geometry_search.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <limits>
#include <optional>
#include <utility>

#include "core/base/lists.h"
#include "core/base/odds.h"
#include "core/base/stop.h"
#include "infer/depth/surface_tolerance.h"
#include "infer/initial/agreement.h"
#include "infer/initial/box_fit.h"
#include "infer/initial/floor.h"
#include "infer/initial/initial_pose.h"
#include "infer/initial/side_patch.h"
#include "infer/initial/stack_search.h"
#include "infer/initial/standing_guesses.h"
#include "infer/initial/symmetries.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

/// Candidates of one guess: those that are measured, and those of them that are brought onto the
/// boxes. Without a floor there are many guesses; the third number is the most of all that are
/// measured.
constexpr std::size_t kMostLookedAt = 2 * kBeam, kMostFitted = kBeam / 2;
constexpr std::size_t kMostOfAllGuesses = kBeam * kBeam / 2;
/// Planes that may carry the structure.
constexpr std::size_t kMostFloors = kBeam / 2;
/// Without a floor, where much has to be tried: cells along the smallest edge of any box.
constexpr double kCoarseCells = kCellsAlongEdge / 2;
/// The first measurement has every second ray of every second row.
constexpr int kFirstLook = 2;

/// A plane with so many times the structure's largest area in one plane belongs to the room. Planes
/// are found with tolerances: sides that are turned (25 deg) or offset (m) against each other count
/// as one.
constexpr double kLargerThanStack = 1.3, kAlikePlane = kFarthestOff;

/// Sensors are mounted upright, on a side or overhead.
std::vector<Eigen::Vector3d> UsualUps() {
  return {-Eigen::Vector3d::UnitY(), -Eigen::Vector3d::UnitX(), Eigen::Vector3d::UnitX(),
          Eigen::Vector3d::UnitY()};
}

using Poses = std::vector<GeometricPose>;

void SortByGain(Poses* poses) {
  SortLargestFirst(poses, [](const GeometricPose& pose) { return pose.shape.Gain(); });
}

template <class Refuted>
Poses Without(Poses poses, const Refuted& is_refuted) {
  poses.erase(std::remove_if(poses.begin(), poses.end(), is_refuted), poses.end());
  return poses;
}

/// The first of each set of poses that are about the same.
Poses Distinct(const Poses& poses, const Structure& structure) {
  Poses distinct;
  for (const GeometricPose& pose : poses) {
    AddIfNew(pose, &distinct, [&](const GeometricPose& other) {
      return SamePose(structure, other.structure_from_sensor, pose.structure_from_sensor);
    });
  }
  return distinct;
}

/// The largest area of the structure that may be found in one plane, m^2.
double LargestFlat(const Structure& structure) {
  double largest = 0;
  for (const Side& side : structure.sides()) {
    double area = 0;
    for (const Side& other : structure.sides()) {
      if (other.normal.dot(side.normal) > kOnePlane &&
          std::abs(side.normal.dot(other.centre - side.centre)) < kAlikePlane)
        area += other.exposed_area;
    }
    largest = std::max(largest, area);
  }
  return largest;
}

/// Share of the area of all points that lies clearly behind a plane.
double ShareBehind(const RoomPlane& plane, const SurfaceInRoom& view) {
  const SurfaceTolerance tolerance = SurfaceTolerance::OfPlane(view.surface.view.errors);
  double behind = 0, all = 0;
  for (const OrientedPoint& point : view.floor_points) {
    all += point.area;
    const double height = plane.normal.dot(point.p) - plane.offset;
    if (height < -kClearly * tolerance(point.p.z())) behind += point.area;
  }
  return behind / all;
}

class Search {
 public:
  Search(const SurfaceInRoom& view, const Structure& structure)
      : view_(view), structure_(structure) {}

  /// `tables`: on the planes that have more than a little behind them.
  Poses CandidatesOnFloors(bool tables) const {
    Poses found;
    for (const Poses& poses : RoughOnFloors(kCellsAlongEdge, tables))
      Append(FitWell(poses, true), &found);
    return found;
  }

  std::optional<GeometricPose> BestOnFloors() const {
    Poses found;
    for (const bool tables : {false, true}) {
      if (!found.empty()) break;
      for (const Poses& poses : RoughOnFloors(kCoarseCells, tables)) Append(poses, &found);
    }
    if (found.empty()) return std::nullopt;
    // The rough order of two is no more than a hint.
    KeepLargest(2, &found, [](const GeometricPose& pose) { return pose.shape.Gain(); });
    found = FitWell(std::move(found), true);
    SortByGain(&found);
    const GeometricPose& best = found.front();
    return FloorAt(best).balance() > 0 ? std::optional(best) : std::nullopt;
  }

  /// Keeps those with the structure's shape that do not float. A side of the structure itself may
  /// have been taken for the floor.
  Poses Verified(Poses poses) const {
    return Without(std::move(poses), [&](const GeometricPose& pose) {
      return !HasShape(pose.shape) || FloorAt(pose).Floats();
    });
  }

  Poses CandidatesWithoutFloor() const {
    const StackOutline coarse = MakeStackOutline(structure_, kCoarseCells);
    const std::vector<RoomPlane> small =
        FindRoomPlanes(view_.points, kBeam, view_.surface.view.errors);
    std::vector<StackCandidate> candidates;
    for (const StandingGuess& guess :
         GuessWithoutFloor(view_.points, view_.planes, small, structure_, coarse, UsualUps())) {
      Append(SearchStack(view_.points, coarse, {guess}, kBeam).front(), &candidates);
    }
    KeepLargest(kMostOfAllGuesses, &candidates, [](const auto& each) { return each.votes; });
    Poses found = CandidatesOnFloors(true);
    Append(FitWell(FitRoughly(Look(candidates), false), false), &found);
    return found;
  }

  /// The largest sum of the log odds of shape and floor among the poses; minus infinity without
  /// any.
  double BestWithFloor(const Poses& poses) const {
    double best = -std::numeric_limits<double>::infinity();
    for (const GeometricPose& pose : poses)
      best = std::max(best, pose.shape.LogOdds() + FloorAt(pose).LogOdds());
    return best;
  }

  /// The poses, then their symmetric poses.
  Poses WithSymmetries(const Poses& poses, const std::vector<StructureSymmetry>& symmetries) const {
    Poses moved;
    for (const GeometricPose& pose : poses) {
      for (const StructureSymmetry& symmetry : symmetries)
        moved.push_back(Measured(symmetry.motion * pose.structure_from_sensor, false));
    }
    SortByGain(&moved);
    Poses all = poses;
    // Compete decides which of them explain as much as their originals.
    Append(FitWell(Distinct(moved, structure_), false), &all);
    return all;
  }

 private:
  template <class T>
  static void Append(std::vector<T> more, std::vector<T>* all) {
    std::move(more.begin(), more.end(), std::back_inserter(*all));
  }

  FloorFit FloorAt(const GeometricPose& pose) const {
    return FindFloor(view_.surface.view, structure_, pose.structure_from_sensor);
  }

  /// The pose as the first look or, with `closely`, as all rays show it.
  GeometricPose Measured(const Pose& pose, bool closely) const {
    return {pose, MeasureShape(closely ? view_.surface : view_.first_look, structure_, pose)};
  }

  /// One list for each floor, the best pose first.
  std::vector<Poses> RoughOnFloors(double cells, bool tables) const {
    std::vector<StandingGuess> floors;
    for (const RoomPlane& plane : view_.planes) {
      // Behind a floor there are at most reflections, or a stair.
      if ((ShareBehind(plane, view_) > kNotable) == tables && floors.size() < kMostFloors)
        floors.push_back({plane.normal, {plane.offset}, {}});
    }
    std::vector<Poses> rough;
    for (const auto& candidates :
         SearchStack(view_.points, MakeStackOutline(structure_, cells), floors, kMostLookedAt))
      rough.push_back(FitRoughly(Look(candidates), true));
    return rough;
  }

  Poses Look(const std::vector<StackCandidate>& candidates) const {
    Poses poses;
    for (const StackCandidate& candidate : candidates) {
      ThrowIfStopped();
      poses.push_back(Measured(candidate.structure_from_sensor, false));
    }
    SortByGain(&poses);
    return poses;
  }

  Poses FitRoughly(Poses poses, bool floor) const {
    if (poses.size() > kMostFitted) poses.resize(kMostFitted);
    BoxFit fit;
    fit.floor = floor;
    const std::vector<OrientedPoint>& points = floor ? view_.floor_points : view_.points;
    for (GeometricPose& pose : poses)
      pose = Measured(FitToBoxes(points, structure_, fit, pose.structure_from_sensor), false);
    SortByGain(&poses);
    return Distinct(poses, structure_);
  }

  /// Fits with more points and measures with all rays. With `floor`, floor points count where that
  /// explains more: few sides may leave a direction open, but not every floor is flat.
  Poses FitWell(Poses poses, bool floor) const {
    if (poses.size() > kBeam) poses.resize(kBeam);
    const auto fitted = [&](const GeometricPose& pose, bool to_floor) {
      const BoxFit fit{4, 1500, 2 * kRoughPose, kRoughPose, to_floor};
      return Measured(FitToBoxes(to_floor ? view_.floor_points : view_.points, structure_, fit,
                                 pose.structure_from_sensor),
                      true);
    };
    for (GeometricPose& pose : poses) {
      const GeometricPose alone = fitted(pose, false);
      if (floor) pose = fitted(pose, true);
      if (!floor || alone.shape.Gain() > pose.shape.Gain()) pose = alone;
    }
    return poses;
  }

  const SurfaceInRoom& view_;
  const Structure& structure_;
};

/// A side is tilted if its measured plane differs from the pose's by more than this angle, rad (12
/// deg), and this many standard deviations. Smaller patches, m^2, say nothing.
constexpr double kTilted = 12 * kDegree, kTiltSigmas = 2, kLeastPatch = 0.02;

bool IsTilted(const SidePatch& patch, const Structure& structure,
              const Pose& structure_from_sensor) {
  const Eigen::Vector3d normal = structure_from_sensor.linear() * patch.normal;
  // A side seen edge-on may have its normal on either side.
  const double cosine = std::abs(normal.dot(structure.SideOfLabel(patch.label).normal));
  return patch.area > kLeastPatch &&
         std::acos(std::min(1.0, cosine)) > kTilted + kTiltSigmas * patch.normal_sigma;
}

double BestShape(const Poses& poses) {
  double best = -std::numeric_limits<double>::infinity();
  for (const GeometricPose& pose : poses) best = std::max(best, pose.shape.LogOdds());
  return best;
}

/// Leaves out poses that the shape refutes as against the best one, and those that explain notably
/// less than another one does. 1 of 100 sensors' poses does (view_fit.cc has the measurement). The
/// best first.
Poses Compete(Poses poses, const Structure& structure) {
  const double best = BestShape(poses);
  double most = 0;
  for (const GeometricPose& pose : poses) most = std::max(most, pose.shape.explained);
  const auto log_odds = [](const GeometricPose& pose) { return pose.shape.LogOdds(); };
  poses = Without(std::move(poses), [&](const GeometricPose& pose) {
    return log_odds(pose) < best - std::log(kDecisiveOdds) ||
           pose.shape.explained < (1 - kNotable) * most;
  });
  SortLargestFirst(&poses, log_odds);
  return Distinct(poses, structure);
}

}  // namespace

SurfaceInRoom LookAround(const SensorView& view, const Structure& structure) {
  SurfaceInRoom seen;
  seen.surface = MakeSensorSurface(view, kCoarseRays);
  seen.floor_points = PointsOf(seen.surface);
  seen.planes = FindRoomPlanes(seen.floor_points, kBeam, seen.surface.view.errors);
  MarkRoom(seen.planes, kLargerThanStack * LargestFlat(structure), &seen.surface);
  seen.first_look = Decimate(seen.surface, kFirstLook);
  seen.points = PointsOf(seen.surface);
  return seen;
}

std::optional<GeometricPose> FindBestOnFloors(const SurfaceInRoom& view,
                                              const Structure& structure) {
  return Search(view, structure).BestOnFloors();
}

std::vector<GeometricPose> FindPosesByGeometry(const SensorView& view, const Structure& structure,
                                               const std::vector<StructureSymmetry>& symmetries) {
  const SurfaceInRoom surface = LookAround(view, structure);
  const Search search(surface, structure);
  const Poses on_floors = search.CandidatesOnFloors(false);
  Poses found = search.Verified(on_floors);
  // A shape with poor odds may be other boxes that stand on the floor.
  if (BestShape(found) < std::log(kDecisiveOdds)) {
    Poses candidates = search.CandidatesWithoutFloor();
    candidates.insert(candidates.end(), on_floors.begin(), on_floors.end());
    Poses others = search.Verified(std::move(candidates));
    if (search.BestWithFloor(others) > search.BestWithFloor(found)) found = std::move(others);
  }
  found = Compete(std::move(found), structure);
  return Compete(search.WithSymmetries(found, symmetries), structure);
}

std::optional<double> ShapeLogOdds(const SensorView& view, const Structure& structure,
                                   const Pose& structure_from_sensor) {
  if (FindFloor(view, structure, structure_from_sensor).Floats()) return std::nullopt;
  const double log_odds =
      MeasureShape(LookAround(view, structure).surface, structure, structure_from_sensor).LogOdds();
  if (log_odds <= -std::log(kDecisiveOdds)) return std::nullopt;
  const std::vector<SidePatch> patches = CollectPatches(
      view,
      LabelsFromPose(view, structure, structure_from_sensor, SurfaceTolerance::AtPose(view.errors)),
      structure);
  const bool tilted = std::any_of(patches.begin(), patches.end(), [&](const SidePatch& patch) {
    return IsTilted(patch, structure, structure_from_sensor);
  });
  return tilted ? std::nullopt : std::optional<double>(log_odds);
}

}  // namespace volalign
