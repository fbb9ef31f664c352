#include "infer/initial/aliases.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <unordered_map>
#include <utility>

#include "core/base/lists.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

/// m: motions whose translations differ by less are one motion.
constexpr double kSameMotion = 2 * kSamePlace;
/// Cosine of the angle between two verticals below which a motion is called upside down.
constexpr double kUpsideDown = -0.5;
/// deg: a smaller turn is called no turn.
constexpr double kTurned = 5;
/// Cosine of the angle within which axes are the same; the most sets of axes that are tried.
const double kAligned = std::cos(kTurned * kDegree);
constexpr std::size_t kMostAxes = kBeam / 2;
/// Far above rounding errors of coordinates, far below tolerances, m.
constexpr double kRounding = 1e-6;

using Corners = std::array<Eigen::Vector3d, 8>;

/// Is every corner of one box near some corner of the other?
bool SameSolid(const Corners& a, const Corners& b, double distance) {
  return std::all_of(a.begin(), a.end(), [&](const Eigen::Vector3d& p) {
    return std::any_of(b.begin(), b.end(),
                       [&](const Eigen::Vector3d& q) { return (p - q).norm() < distance; });
  });
}

/// The 24 turns that take the axes to the axes.
std::vector<Eigen::Matrix3d> AxisTurns() {
  std::vector<Eigen::Matrix3d> turns;
  std::array<int, 3> order{0, 1, 2};
  do {
    for (int signs = 0; signs < 8; ++signs) {
      Eigen::Matrix3d turn = Eigen::Matrix3d::Zero();
      for (int axis = 0; axis < 3; ++axis)
        turn(order[static_cast<std::size_t>(axis)], axis) = signs >> axis & 1 ? -1 : 1;
      if (turn.determinant() > 0) turns.push_back(turn);
    }
  } while (std::next_permutation(order.begin(), order.end()));
  return turns;
}

/// The turns that take one box's axes to another's. A box within kTurned of the structure's axes
/// counts as parallel to them. Only the kMostAxes sets of axes that most boxes share are tried.
std::vector<Eigen::Matrix3d> TurnsBetween(const std::vector<Box>& boxes) {
  std::vector<std::pair<Eigen::Matrix3d, int>> axes{{Eigen::Matrix3d::Identity(), 0}};
  for (const Box& box : boxes) {
    const Eigen::Matrix3d own = box.structure_from_box.linear();
    const auto same = std::find_if(axes.begin(), axes.end(), [&](const auto& other) {
      return (other.first.transpose() * own).cwiseAbs().colwise().maxCoeff().minCoeff() > kAligned;
    });
    if (same == axes.end()) {
      axes.emplace_back(own, 1);
    } else {
      ++same->second;
    }
  }
  SortLargestFirst(&axes, [](const auto& set) { return set.second; });
  if (axes.back().second == 0) axes.pop_back();
  if (axes.size() > kMostAxes) axes.resize(kMostAxes);
  std::vector<Eigen::Matrix3d> turns;
  for (const auto& to : axes) {
    for (const auto& from : axes) {
      for (const Eigen::Matrix3d& between : AxisTurns()) {
        const Eigen::Matrix3d turn = to.first * between * from.first.transpose();
        AddIfNew(turn, &turns, [&](const Eigen::Matrix3d& other) {
          return (other.transpose() * turn).trace() > 1 + 2 * kAligned;
        });
      }
    }
  }
  return turns;
}

/// Points on a grid whose cells are as large as the distance of the search.
class PointGrid {
 public:
  explicit PointGrid(double distance) : distance_(distance) {}

  void Add(const Eigen::Vector3d& point, int value) { cells_[CellOf(point)].push_back(value); }

  /// Calls visit(value) for every point within the distance of `point`, and for some that are
  /// farther away.
  template <class Visit>
  void VisitNear(const Eigen::Vector3d& point, const Visit& visit) const {
    const Cell middle = CellOf(point);
    for (int dx = -1; dx <= 1; ++dx) {
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dz = -1; dz <= 1; ++dz) {
          const auto cell = cells_.find({middle[0] + dx, middle[1] + dy, middle[2] + dz});
          if (cell == cells_.end()) continue;
          for (const int value : cell->second) visit(value);
        }
      }
    }
  }

 private:
  using Cell = std::array<std::int64_t, 3>;
  struct Hash {
    std::size_t operator()(const Cell& cell) const {
      std::uint64_t hash = 0;
      for (const std::int64_t x : cell)
        hash = (hash ^ static_cast<std::uint64_t>(x)) * 0x9e3779b97f4a7c15u;
      return static_cast<std::size_t>(hash ^ hash >> 32);
    }
  };
  Cell CellOf(const Eigen::Vector3d& point) const {
    return {static_cast<std::int64_t>(std::floor(point.x() / distance_)),
            static_cast<std::int64_t>(std::floor(point.y() / distance_)),
            static_cast<std::int64_t>(std::floor(point.z() / distance_))};
  }

  double distance_;
  std::unordered_map<Cell, std::vector<int>, Hash> cells_;
};

/// `side_centres` has the index of each of the structure's sides at the side's centre.
std::vector<std::uint8_t> LabelsAfter(const Structure& structure, const PointGrid& side_centres,
                                      const Pose& motion) {
  std::vector<std::uint8_t> after(static_cast<std::size_t>(structure.num_classes()), 0);
  for (int label = 1; label < structure.num_classes(); ++label) {
    const Side& side = structure.SideOfLabel(label);
    const Eigen::Vector3d centre = motion * side.centre;
    int last = -1;
    side_centres.VisitNear(centre, [&](int index) {
      const Side& other = structure.sides()[static_cast<std::size_t>(index)];
      if ((centre - other.centre).norm() < kSamePlace &&
          (motion.linear() * side.normal).dot(other.normal) > kSameNormal)
        last = std::max(last, index);
    });
    if (last >= 0)
      after[static_cast<std::size_t>(label)] =
          structure.sides()[static_cast<std::size_t>(last)].label;
  }
  return after;
}

/// A translation that, after a turn, brings one box onto another.
struct Fit {
  std::size_t from = 0, to = 0;
};

/// For one turn: all pairs of boxes of which the first comes to lie on the second by a translation.
/// A symmetry needs a fit for each box that it moves onto a box. Most translations have too few;
/// only the others are examined box by box.
class Fits {
 public:
  Fits(const std::vector<Corners>& corners, const Eigen::Matrix3d& turn)
      : corners_(corners), by_translation_(kSamePlace) {
    for (std::size_t from = 0; from < corners.size(); ++from) {
      Corners turned = corners[from];
      for (Eigen::Vector3d& p : turned) p = turn * p;
      for (std::size_t to = 0; to < corners.size(); ++to) AddPair(turned, from, to);
    }
  }

  /// Boxes that the motion, which has the turn, brings onto a box; 0 if they are less than half.
  int CountBoxes(const Pose& motion) const {
    std::vector<Fit> near;
    by_translation_.VisitNear(motion.translation(), [&](int index) {
      near.push_back(fits_[static_cast<std::size_t>(index)]);
    });
    if (2 * near.size() < corners_.size()) return 0;
    std::vector<char> fitted(corners_.size(), 0);
    int boxes = 0;
    for (const Fit& fit : near) {
      if (fitted[fit.from]) continue;
      Corners moved = corners_[fit.from];
      for (Eigen::Vector3d& p : moved) p = motion * p;
      if (!SameSolid(moved, corners_[fit.to], kSamePlace)) continue;
      fitted[fit.from] = 1;
      ++boxes;
    }
    return 2 * boxes < static_cast<int>(corners_.size()) ? 0 : boxes;
  }

 private:
  /// The first corner has to come within kSamePlace of some corner of the other box. A motion that
  /// brings it there may shift the others by as much again.
  void AddPair(const Corners& turned, std::size_t from, std::size_t to) {
    for (const Eigen::Vector3d& corner : corners_[to]) {
      const Eigen::Vector3d translation = corner - turned[0];
      Corners moved = turned;
      for (Eigen::Vector3d& p : moved) p += translation;
      if (!SameSolid(moved, corners_[to], 2 * kSamePlace + kRounding)) continue;
      by_translation_.Add(translation, static_cast<int>(fits_.size()));
      fits_.push_back({from, to});
    }
  }

  const std::vector<Corners>& corners_;
  std::vector<Fit> fits_;
  PointGrid by_translation_;  // of indices into fits_
};

}  // namespace

std::vector<StructureAlias> FindAliases(const Structure& structure) {
  const std::vector<Box>& boxes = structure.boxes();
  std::vector<Corners> corners;
  corners.reserve(boxes.size());
  for (const Box& box : boxes) corners.push_back(box.Corners());
  PointGrid side_centres(kSamePlace);
  for (std::size_t i = 0; i < structure.sides().size(); ++i)
    side_centres.Add(structure.sides()[i].centre, static_cast<int>(i));

  std::vector<StructureAlias> aliases;
  for (const Eigen::Matrix3d& turn : TurnsBetween(boxes)) {
    const Fits fits(corners, turn);
    const std::size_t first = aliases.size();
    for (const Box& from : boxes) {
      for (const Box& to : boxes) {
        StructureAlias alias;
        alias.motion.linear() = turn;
        alias.motion.translation() =
            to.structure_from_box.translation() - turn * from.structure_from_box.translation();
        const auto same = [&](const StructureAlias& other) {
          return (other.motion.translation() - alias.motion.translation()).norm() < kSameMotion;
        };
        const bool identity =
            turn.trace() > 1 + 2 * kAligned && alias.motion.translation().norm() < kSameMotion;
        if (identity ||
            std::any_of(aliases.begin() + static_cast<std::ptrdiff_t>(first), aliases.end(), same))
          continue;
        alias.boxes = fits.CountBoxes(alias.motion);
        if (alias.boxes == 0) continue;
        alias.label_after = LabelsAfter(structure, side_centres, alias.motion);
        aliases.push_back(std::move(alias));
      }
    }
  }
  SortLargestFirst(&aliases, [](const StructureAlias& alias) { return alias.boxes; });
  return aliases;
}

bool LeavesFloor(const Pose& from, const Pose& to) {
  const Pose motion = to * from.inverse();
  return motion.linear()(1, 1) < kFacesAlike || std::abs(motion.translation().y()) > kSameMotion;
}

std::string DescribeMotion(const Pose& from, const Pose& to) {
  const Pose motion = to * from.inverse();
  if (motion.linear()(1, 1) < kUpsideDown) return "upside down";
  if (motion.linear()(1, 1) < -kUpsideDown) return "laid on another side";
  const double turn = std::atan2(motion.linear()(0, 2), motion.linear()(0, 0)) / kDegree;
  const double rise = motion.translation().y();
  if (std::abs(rise) < kSamePlace) {
    const double aside = std::hypot(motion.translation().x(), motion.translation().z());
    return std::abs(turn) > kTurned ? fmt::format("turned by {:.0f} deg", std::abs(turn))
                                    : fmt::format("shifted by {:.2f} m", aside);
  }
  return fmt::format("turned by {:.0f} deg and {:.2f} m {}", std::abs(turn), std::abs(rise),
                     rise > 0 ? "higher" : "lower");
}

}  // namespace volalign
