#include "infer/pose/aliases.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace volalign {

namespace {

/// Corners and sides that are nearer than this lie in the same place, m.
constexpr double kSamePlace = 0.02;
/// Motions by translations that differ by less are the same one, m.
constexpr double kSameMotion = 2 * kSamePlace;
/// Cosine of the angle between normals from which on two sides face the same way.
constexpr double kSameDirection = 0.99;
/// Cosine of the angle between two verticals below which a motion is called upside down.
constexpr double kUpsideDown = -0.5;

using Corners = std::array<Eigen::Vector3d, 8>;

Corners CornersOf(const Box& box) {
  Corners corners;
  for (std::size_t k = 0; k < corners.size(); ++k) {
    const Eigen::Vector3d sign(k & 1 ? 1 : -1, k & 2 ? 1 : -1, k & 4 ? 1 : -1);
    corners[k] = box.structure_from_box * Eigen::Vector3d(sign.cwiseProduct(box.size) / 2);
  }
  return corners;
}

bool SameSolid(const Corners& a, const Corners& b) {
  return std::all_of(a.begin(), a.end(), [&](const Eigen::Vector3d& p) {
    return std::any_of(b.begin(), b.end(),
                       [&](const Eigen::Vector3d& q) { return (p - q).norm() < kSamePlace; });
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

std::vector<std::uint8_t> LabelsAfter(const Structure& structure, const Pose& motion) {
  std::vector<std::uint8_t> after(static_cast<std::size_t>(structure.num_classes()), 0);
  for (int label = 1; label < structure.num_classes(); ++label) {
    const Side& side = structure.SideOfLabel(label);
    for (const Side& other : structure.sides()) {
      if ((motion * side.centre - other.centre).norm() < kSamePlace &&
          (motion.linear() * side.normal).dot(other.normal) > kSameDirection)
        after[static_cast<std::size_t>(label)] = other.label;
    }
  }
  return after;
}

}  // namespace

std::vector<StructureAlias> FindAliases(const Structure& structure) {
  const std::vector<Box>& boxes = structure.boxes();
  std::vector<Corners> corners;
  for (const Box& box : boxes) corners.push_back(CornersOf(box));
  std::vector<StructureAlias> aliases;
  for (const Eigen::Matrix3d& turn : AxisTurns()) {
    for (const Box& from : boxes) {
      for (const Box& to : boxes) {
        StructureAlias alias;
        alias.motion.linear() = turn;
        alias.motion.translation() =
            to.structure_from_box.translation() - turn * from.structure_from_box.translation();
        const auto known = [&](const StructureAlias& other) {
          return other.motion.linear().isApprox(turn) &&
                 (other.motion.translation() - alias.motion.translation()).norm() < kSameMotion;
        };
        const bool identity = turn.isIdentity() && alias.motion.translation().norm() < kSameMotion;
        if (identity || std::any_of(aliases.begin(), aliases.end(), known)) continue;
        for (const Corners& box : corners) {
          Corners moved = box;
          for (Eigen::Vector3d& p : moved) p = alias.motion * p;
          alias.boxes += std::any_of(corners.begin(), corners.end(),
                                     [&](const Corners& other) { return SameSolid(moved, other); });
        }
        if (alias.boxes == 0 || 2 * alias.boxes < static_cast<int>(boxes.size())) continue;
        alias.label_after = LabelsAfter(structure, alias.motion);
        aliases.push_back(std::move(alias));
      }
    }
  }
  std::stable_sort(
      aliases.begin(), aliases.end(),
      [](const StructureAlias& a, const StructureAlias& b) { return a.boxes > b.boxes; });
  return aliases;
}

std::string DescribeMotion(const Pose& from, const Pose& to) {
  const Pose motion = to * from.inverse();
  if (motion.linear()(1, 1) < kUpsideDown) return "upside down";
  const double turn = std::atan2(motion.linear()(0, 2), motion.linear()(0, 0)) * 180 / M_PI;
  const double rise = motion.translation().y();
  return fmt::format("turned by {:.0f} deg and {:.2f} m {}", std::abs(turn), std::abs(rise),
                     rise > 0 ? "higher" : "lower");
}

}  // namespace volalign
