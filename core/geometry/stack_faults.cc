#include "core/geometry/stack_faults.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <optional>

#include "core/base/error.h"

namespace volalign {

namespace {

constexpr double kShortestBox = 0.1, kLongestBox = 5;  // m, of the longest edge
constexpr double kWidestSlip = 0.05;  // m, from rough measures and slips; a wider gap is intended
constexpr double kUpright = 1 - 1e-6;
/// Least sum of squared cosines between the sides' normals and any direction: one side at 15 deg.
constexpr double kLeastSpread = 0.07;

/// Gap of two boxes along a direction; negative if they overlap.
double GapAlong(const Box& a, const Box& b, const Eigen::Vector3d& direction) {
  const auto reach = [&](const Box& box) {
    return (box.structure_from_box.linear().transpose() * direction).cwiseAbs().dot(box.size) / 2;
  };
  const Eigen::Vector3d between =
      b.structure_from_box.translation() - a.structure_from_box.translation();
  return std::abs(between.dot(direction)) - reach(a) - reach(b);
}

/// Directions of which one separates any two boxes that share no space.
std::vector<Eigen::Vector3d> SeparatingDirections(const Box& a, const Box& b) {
  const Eigen::Matrix3d ra = a.structure_from_box.linear(), rb = b.structure_from_box.linear();
  std::vector<Eigen::Vector3d> directions;
  for (int i = 0; i < 3; ++i) {
    directions.emplace_back(ra.col(i));
    directions.emplace_back(rb.col(i));
    for (int j = 0; j < 3; ++j) {
      const Eigen::Vector3d across = ra.col(i).cross(rb.col(j));
      if (across.norm() > 1e-3) directions.push_back(across.normalized());
    }
  }
  return directions;
}

constexpr bool kLevel = true;
/// The widest gap along the separating directions: the distance of the boxes. kLevel: along those
/// that are level, as seen from above.
double Gap(const Box& a, const Box& b, bool level = false) {
  double widest = -1e9;
  for (const Eigen::Vector3d& direction : SeparatingDirections(a, b)) {
    if (!level || std::abs(direction.y()) < 1e-3)
      widest = std::max(widest, GapAlong(a, b, direction));
  }
  return widest;
}

bool IsUpright(const Box& box) {
  return box.structure_from_box.linear().row(1).cwiseAbs().maxCoeff() > kUpright;
}

double Millimetres(double metres) { return std::round(1000 * metres); }

class Stack {
 public:
  explicit Stack(const Structure& structure)
      : structure_(structure), boxes_(structure.boxes()), floor_(structure.FloorHeight()) {}

  std::vector<StackFault> Faults() {
    FindDirections();
    for (const Box& box : boxes_)
      if (!box.mesh) FindUnits(box);
    for (std::size_t b = 0; b < boxes_.size(); ++b) {
      const bool shares = FindShared(b);
      if (!shares) FindStanding(boxes_[b]);
      FindGaps(b);
    }
    return std::move(faults_);
  }

 private:
  void Add(bool impossible, std::string text) { faults_.push_back({impossible, std::move(text)}); }

  /// Three planes fix a place.
  void FindDirections() {
    if (structure_.IsOfBoxes()) return;
    Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
    int sides = 0;
    for (const Side& side : structure_.sides()) {
      if (side.label == 0) continue;
      spread += side.normal * side.normal.transpose();
      ++sides;
    }
    const Eigen::Vector3d along =
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(spread, Eigen::EigenvaluesOnly)
            .eigenvalues();
    if (along[0] > kLeastSpread) return;
    Add(true,
        fmt::format("the flat sides of the mesh ({}) face in fewer than three directions, so they "
                    "do not fix a pose: take an object with more flat sides",
                    sides));
  }

  void FindUnits(const Box& box) {
    const double longest = box.size.maxCoeff();
    if (longest >= kShortestBox && longest <= kLongestBox) return;
    Add(false,
        fmt::format("box '{}' is {:g} x {:g} x {:g} mm; a file of boxes is written in millimetres, "
                    "and Python and C take metres: check the unit",
                    box.name, Millimetres(box.size.x()), Millimetres(box.size.y()),
                    Millimetres(box.size.z())));
  }

  /// Does it share space with any other box?
  bool FindShared(std::size_t b) {
    bool shares = false;
    for (std::size_t a = 0; a < boxes_.size(); ++a) {
      if (boxes_[a].mesh || boxes_[b].mesh) continue;
      const double depth = a == b ? 0 : -Gap(boxes_[a], boxes_[b]);
      if (depth <= kStackTolerance) continue;
      shares = true;
      if (a > b) continue;
      Add(depth > kWidestSlip,
          fmt::format("boxes '{}' and '{}' share space, {:g} mm deep: correct the position or "
                      "the size of one of them",
                      boxes_[a].name, boxes_[b].name, Millimetres(depth)));
    }
    return shares;
  }

  void FindStanding(const Box& box) {
    const Eigen::AlignedBox3d around = BoundsOf(box);
    const double bottom = around.min().y();
    if (!structure_.IsOfBoxes() || bottom - floor_ <= kStackTolerance) return;
    Eigen::AlignedBox3d support;  // as seen from above
    bool stands = false, carries = false;
    for (const Box& other : boxes_) {
      carries = carries || RestsOn(other, box);
      if (!RestsOn(box, other)) continue;
      stands = true;
      const Eigen::AlignedBox3d below = BoundsOf(other);
      support.extend(below.min().cwiseMax(around.min()).eval());
      support.extend(below.max().cwiseMin(around.max()).eval());
    }
    if (!stands) return AddFloating(box, bottom);
    const Eigen::Vector3d middle = around.center();
    const Eigen::Vector3d beyond = (support.min() - middle).cwiseMax(middle - support.max());
    const double out = std::max(beyond.x(), beyond.z());
    if (carries || out <= kStackTolerance) return;  // its load may hold it
    Add(false, fmt::format("box '{}' would fall: its middle is {:g} mm beyond what it stands on; "
                           "check its position",
                           box.name, Millimetres(out)));
  }

  void AddFloating(const Box& box, double bottom) {
    const Box* below = nullptr;
    double top = floor_;
    for (const Box& other : boxes_) {
      const double height = BoundsOf(other).max().y();
      if (&other == &box || height > bottom || height < top ||
          Gap(other, box, kLevel) >= -kStackTolerance)
        continue;
      below = &other;
      top = height;
    }
    Add(bottom - top > kWidestSlip,
        fmt::format("box '{}' stands on nothing: its lower side is {:g} mm above {}; correct "
                    "its height, or add what it stands on as a box",
                    box.name, Millimetres(bottom - top),
                    below ? fmt::format("box '{}'", below->name) : "the floor"));
  }

  /// Gaps between a box and the earlier ones.
  void FindGaps(std::size_t b) {
    for (std::size_t a = 0; a < b; ++a) {
      if (boxes_[a].mesh || boxes_[b].mesh) continue;
      const double gap = Gap(boxes_[a], boxes_[b], kLevel);
      if (gap <= kStackTolerance || gap > kWidestSlip ||
          GapAlong(boxes_[a], boxes_[b], Eigen::Vector3d::UnitY()) > -kStackTolerance)
        continue;
      Add(false, fmt::format("there is a gap of {:g} mm between boxes '{}' and '{}': check that it "
                             "is there",
                             Millimetres(gap), boxes_[a].name, boxes_[b].name));
    }
  }

  const Structure& structure_;
  const std::vector<Box>& boxes_;
  double floor_;
  std::vector<StackFault> faults_;
};

}  // namespace

Eigen::AlignedBox3d BoundsOf(const Box& box) {
  Eigen::AlignedBox3d bounds;
  for (const Eigen::Vector3d& corner : box.Corners()) bounds.extend(corner);
  return bounds;
}

bool RestsOn(const Box& box, const Box& below) {
  if (&below == &box) return false;
  if (IsUpright(below) && IsUpright(box)) {
    return std::abs(BoundsOf(below).max().y() - BoundsOf(box).min().y()) <= kStackTolerance &&
           Gap(below, box, kLevel) < -kStackTolerance;
  }
  return Gap(below, box) <= kStackTolerance &&
         below.structure_from_box.translation().y() < box.structure_from_box.translation().y();
}

std::vector<std::size_t> BoxesOn(const std::vector<Box>& boxes, std::size_t box) {
  std::vector<std::size_t> on_it = {box};
  for (std::size_t k = 0; k < on_it.size(); ++k) {
    for (std::size_t other = 0; other < boxes.size(); ++other) {
      if (RestsOn(boxes[other], boxes[on_it[k]]) &&
          std::find(on_it.begin(), on_it.end(), other) == on_it.end())
        on_it.push_back(other);
    }
  }
  on_it.erase(on_it.begin());
  return on_it;
}

std::vector<StackFault> FindStackFaults(const Structure& structure) {
  return Stack(structure).Faults();
}

void RequireStack(const Structure& structure) {
  for (const StackFault& fault : FindStackFaults(structure))
    if (fault.impossible) throw DataError(fault.text);
}

}  // namespace volalign
