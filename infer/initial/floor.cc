#include "infer/initial/floor.h"

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <map>
#include <optional>

#include "core/base/odds.h"
#include "core/geometry/visibility.h"
#include "infer/depth/explain_view.h"
#include "infer/depth/share_odds.h"
#include "infer/initial/oriented_points.h"
#include "infer/initial/stack_outline.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

/// Distance within which a point lies on the floor, in m and per metre of depth. Depth errors grow
/// with distance, and a pose that is off by a degree tilts a far floor.
constexpr double kTolerance = kRoughPose, kRelativeTolerance = 0.02;
/// m: a floor less far under the structure carries no table.
constexpr double kLeastTable = 0.3;
/// m: height of the cells in which that floor is searched for.
constexpr double kLevelCell = 2 * kSamePlace;

/// A point clearly under the structure's foot.
struct LowPoint {
  double depth = 0;         // m, under the foot
  double clearly = 0;       // m: how much lower than a level is clearly under it
  bool passing = false;     // see FloorFit
  bool on_a_floor = false;  // faces up, at least kLeastTable under the foot
};

/// Depth of most of the surface that faces up, m, under the foot: the floor that a table may stand
/// on. 0 where there is too little.
double LowerFloor(const std::vector<LowPoint>& points, int pixels) {
  std::map<int, int> cells;
  for (const LowPoint& point : points) {
    if (point.on_a_floor) ++cells[static_cast<int>(std::lround(point.depth / kLevelCell))];
  }
  int most = 0;
  double depth = 0;
  for (const auto& [cell, count] : cells) {
    const auto next = cells.find(cell + 1);
    const int both = count + (next != cells.end() ? next->second : 0);
    if (both <= most) continue;
    most = both;
    depth = (cell + 0.5) * kLevelCell;
  }
  return most >= kNotable * pixels ? depth : 0;
}

/// The surroundings of the structure's foot.
class Foot {
 public:
  explicit Foot(const Structure& structure)
      : structure_(structure), height_(structure.FloorHeight()), bounds_(BoundsOf(structure)) {}

  double height() const { return height_; }
  bool IsNear(const Eigen::Vector3d& p) const {
    return bounds_.squaredExteriorDistance(p) <= kFarthestOff * kFarthestOff &&
           DistanceToSurface(structure_, p).distance <= kFarthestOff;
  }
  /// Does a ray from `origin` to a point under the foot pass its plane near the structure?
  bool IsPassedBy(const Eigen::Vector3d& origin, const Eigen::Vector3d& low) const {
    if (!(origin.y() > height_)) return false;
    const double share = (origin.y() - height_) / (origin.y() - low.y());
    return IsNear(origin + share * (low - origin));
  }

 private:
  const Structure& structure_;
  double height_;
  Eigen::AlignedBox3d bounds_;
};

// The share of a view that lies on the floor, in recorded frames, by tests/bench/cause_shares.py.
constexpr ShareOdds kOnFloor{{9.3, 15.7}, {0.114, 26}};

}  // namespace

double FloorFit::LogOdds() const {
  const double of_pixel = pixels > 0 ? cells / pixels : 0;
  return kOnFloor.LogOdds(of_pixel * on_floor, of_pixel * (pixels - on_floor)) + LogOddsByBelow();
}

double FloorFit::LogOddsByBelow() const {
  const double of_pixel = pixels > 0 ? cells / pixels : 0;
  const double odds = LogOddsOfSurface(of_pixel * on_floor, of_pixel * below);
  return HasSupport() ? std::max(odds, -std::log(kDecisiveOdds)) : odds;
}

bool FloorFit::Floats() const {
  return !HasSupport() && LogOddsByBelow() <= -std::log(kDecisiveOdds);
}

FloorFit FindFloor(const SensorView& view, const Structure& structure,
                   const Pose& structure_from_sensor) {
  return FindFloors(view, structure, {structure_from_sensor}).front();
}

std::vector<FloorFit> FindFloors(const SensorView& view, const Structure& structure,
                                 const std::vector<Pose>& poses) {
  const Foot foot(structure);
  std::vector<FloorFit> fits(poses.size());
  std::vector<std::vector<LowPoint>> low(poses.size());
  const int stride = StrideForRays(view.depth.size(), kCoarseRays);
  view.VisitMeasured(stride, [&](int u, int v) {
    const double own_cells = stride * stride * CellsOf(view, u, v);
    for (FloorFit& fit : fits) {
      ++fit.pixels;
      fit.cells += own_cells;
    }
    const Eigen::Vector3d measured = view.Point(u, v);
    const double tolerance = kTolerance + kRelativeTolerance * view.depth(u, v);
    std::optional<Eigen::Vector3d> normal;
    const auto faces_up = [&](const Pose& pose) {
      if (!normal) normal = NormalAt(view, u, v);
      return pose.linear().row(1).dot(*normal);
    };
    std::optional<bool> on_structure;  // at any of the poses
    const auto is_on_structure = [&] {
      if (!on_structure) {
        on_structure = std::any_of(poses.begin(), poses.end(), [&](const Pose& pose) {
          return DistanceToSurface(structure, pose * measured).distance <= kTolerance;
        });
      }
      return *on_structure;
    };
    for (std::size_t k = 0; k < poses.size(); ++k) {
      const Eigen::Vector3d p = poses[k] * measured;
      const double height = p.y() - foot.height();
      if (height < -kClearly * tolerance) {
        low[k].push_back({-height, kClearly * tolerance, foot.IsPassedBy(poses[k].translation(), p),
                          -height >= kLeastTable && faces_up(poses[k]) >= kFacesAlike});
      } else if (std::abs(height) < tolerance && std::abs(faces_up(poses[k])) >= kFacesAlike &&
                 !is_on_structure()) {
        ++fits[k].on_floor;
        fits[k].beside += foot.IsNear(p) ? 1 : 0;
      }
    }
  });
  for (std::size_t k = 0; k < poses.size(); ++k) {
    const double lower = LowerFloor(low[k], fits[k].pixels);
    for (const LowPoint& point : low[k]) {
      if (!(point.depth > lower + point.clearly)) continue;
      ++fits[k].below;
      fits[k].passing += point.passing ? 1 : 0;
    }
  }
  return fits;
}

double FloorMargin(const SensorView& view, const Structure& structure,
                   const std::vector<StructureSymmetry>& symmetries,
                   const Pose& structure_from_sensor) {
  std::vector<Pose> poses = {structure_from_sensor};
  for (const StructureSymmetry& symmetry : symmetries)
    poses.push_back(symmetry.motion * structure_from_sensor);
  const std::vector<FloorFit> floors = FindFloors(view, structure, poses);
  double margin = std::numeric_limits<double>::infinity();
  for (std::size_t a = 1; a < poses.size(); ++a)
    margin = std::min(margin, floors.front().LogOdds() - floors[a].LogOdds());
  return margin;
}

}  // namespace volalign
