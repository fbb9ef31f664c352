#include "infer/initial/standing_guesses.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

#include "core/base/lists.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

/// Cosine below which directions are at a right angle, to 15 deg.
const double kAtRightAngle = std::sqrt(1 - kSameDirection * kSameDirection);
/// rad: two turns that differ by less (8 deg) are one.
const double kSameTurn = std::acos(kSameNormal);
/// Sine of the largest angle between up and an upright plane (30 deg).
constexpr double kUpright = 0.5;
/// Surfaces that face up are counted in heights of this part of a slab. A height counts if it has
/// at least this share of the largest area.
constexpr double kHeightCell = 0.2, kLeastLevel = kLeastShown;
/// Feet nearer than this part of a slab are one.
constexpr double kSameFoot = 0.5;

/// The different directions in which planes face, up to their sign.
std::vector<Eigen::Vector3d> Axes(const std::vector<RoomPlane>& planes) {
  std::vector<Eigen::Vector3d> axes;
  for (const RoomPlane& plane : planes) {
    AddIfNew(plane.normal, &axes, [&](const Eigen::Vector3d& axis) {
      return std::abs(axis.dot(plane.normal)) > kSameDirection;
    });
  }
  return axes;
}

void AddDirections(const std::vector<Eigen::Vector3d>& more,
                   std::vector<Eigen::Vector3d>* directions) {
  for (const Eigen::Vector3d& direction : more) {
    AddIfNew(direction, directions,
             [&](const Eigen::Vector3d& other) { return other.dot(direction) > kSameDirection; });
  }
}

std::vector<Eigen::Vector3d> Ups(const std::vector<Eigen::Vector3d>& axes,
                                 const std::vector<Eigen::Vector3d>& usual) {
  std::vector<Eigen::Vector3d> ups;
  for (const Eigen::Vector3d& axis : axes) AddDirections({axis, -axis}, &ups);
  for (std::size_t i = 0; i < axes.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (std::abs(axes[i].dot(axes[j])) > kAtRightAngle) continue;
      const Eigen::Vector3d up = axes[i].cross(axes[j]).normalized();
      AddDirections({up, -up}, &ups);
    }
  }
  // One family of upright planes leaves a turn about their normal open.
  for (const Eigen::Vector3d& up : usual) {
    for (const Eigen::Vector3d& axis : axes) {
      if (std::abs(axis.dot(up)) < kUpright)
        AddDirections({(up - axis.dot(up) * axis).normalized()}, &ups);
    }
  }
  if (ups.size() > 2 * kBeam) ups.resize(2 * kBeam);
  return ups;
}

/// Adds a turn and the three at right angles to it.
void AddTurns(double turn, std::vector<double>* turns) {
  for (int quarter = 0; quarter < 4; ++quarter) {
    const double other = turn + quarter * M_PI / 2;
    AddIfNew(other, turns, [&](double one) {
      return std::abs(std::remainder(one - other, 2 * M_PI)) < kSameTurn;
    });
  }
}

/// Turns that bring a side of the structure to face as some plane does.
std::vector<double> Turns(const Eigen::Vector3d& up, const std::vector<RoomPlane>& planes,
                          const Structure& structure) {
  const Eigen::Matrix3d room = RoomFromSensor(up);
  std::vector<double> turns;
  for (const RoomPlane& plane : planes) {
    if (std::abs(plane.normal.dot(up)) > kAtRightAngle) continue;
    for (const Side& side : structure.sides()) {
      // A turn takes a side's heading to heading - turn.
      if (std::abs(side.normal.y()) < kAtRightAngle)
        AddTurns(Heading(side.normal) - Heading(room * plane.normal), &turns);
    }
  }
  return turns;
}

/// Heights above the foot of sides that face up.
std::vector<double> TopsOf(const Structure& structure) {
  std::vector<double> tops;
  for (const Side& side : structure.sides()) {
    if (side.normal.y() < kOnePlane || !(side.exposed_area > 0)) continue;
    const double top = side.centre.y() - structure.FloorHeight();
    AddIfNew(top, &tops, [&](double other) { return std::abs(other - top) < kSamePlace; });
  }
  return tops;
}

/// The lowest and the highest point's height.
std::pair<double, double> HeightsOf(const std::vector<OrientedPoint>& points,
                                    const Eigen::Vector3d& up) {
  double lowest = std::numeric_limits<double>::infinity(), highest = -lowest;
  for (const OrientedPoint& point : points) {
    lowest = std::min(lowest, up.dot(point.p));
    highest = std::max(highest, up.dot(point.p));
  }
  return {lowest, highest};
}

/// Heights at which surfaces face up, those with the most area first.
std::vector<double> Levels(const std::vector<OrientedPoint>& points, const Eigen::Vector3d& up,
                           double cell) {
  const auto [lowest, highest] = HeightsOf(points, up);
  std::vector<double> areas(static_cast<std::size_t>((highest - lowest) / cell) + 3, 0);
  for (const OrientedPoint& point : points) {
    if (up.dot(point.normal) > kOnePlane)
      areas[static_cast<std::size_t>((up.dot(point.p) - lowest) / cell) + 1] += point.area;
  }
  std::vector<std::pair<double, double>> levels;  // area, height
  double most = 0;
  for (std::size_t k = 1; k + 1 < areas.size(); ++k) {
    const double area = areas[k - 1] + areas[k] + areas[k + 1];
    most = std::max(most, area);
    if (areas[k] < areas[k - 1] || areas[k] <= areas[k + 1]) continue;
    const double shift = (areas[k + 1] - areas[k - 1]) / area;
    levels.emplace_back(area, lowest + (static_cast<double>(k) - 0.5 + shift) * cell);
  }
  std::sort(levels.rbegin(), levels.rend());
  std::vector<double> heights;
  for (const auto& [area, height] : levels) {
    if (area > kLeastLevel * most && heights.size() < kBeam / 2) heights.push_back(height);
  }
  return heights;
}

std::vector<double> Feet(const std::vector<OrientedPoint>& points, const Eigen::Vector3d& up,
                         const Structure& structure, const StackOutline& outline) {
  std::vector<double> feet;
  if (points.empty()) return feet;
  for (const double level : Levels(points, up, kHeightCell * outline.slab)) {
    for (const double top : TopsOf(structure)) {
      AddIfNew(level - top, &feet, [&](double foot) {
        return std::abs(foot - (level - top)) < kSameFoot * outline.slab;
      });
    }
  }
  if (!feet.empty()) return feet;
  const auto [lowest, highest] = HeightsOf(points, up);
  for (double foot = lowest - structure.Height(); foot < highest; foot += outline.slab)
    feet.push_back(foot);
  return feet;
}

}  // namespace

std::vector<StandingGuess> GuessWithoutFloor(const std::vector<OrientedPoint>& points,
                                             const std::vector<RoomPlane>& planes,
                                             const std::vector<RoomPlane>& small,
                                             const Structure& structure,
                                             const StackOutline& outline,
                                             const std::vector<Eigen::Vector3d>& usual) {
  std::vector<StandingGuess> guesses;
  std::vector<RoomPlane> all = planes;
  all.insert(all.end(), small.begin(), small.end());
  for (const Eigen::Vector3d& up : Ups(Axes(all), usual)) {
    const std::vector<double> turns = Turns(up, small, structure);
    if (turns.empty()) continue;
    guesses.push_back({up, Feet(points, up, structure, outline), turns});
  }
  return guesses;
}

}  // namespace volalign
