#include "infer/initial/symmetries.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

#include "core/base/lists.h"
#include "core/geometry/kd_tree.h"
#include "core/geometry/visibility.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

/// m: motions whose translations differ by less are one motion.
constexpr double kSameMotion = 2 * kSamePlace;
/// m: bounds of the limit for a very small and a very large structure.
constexpr double kLeastStep = kRoughPose, kMostStep = 0.2;
constexpr double kPartOfEdge = 0.5;
/// deg: a smaller turn is called no turn.
constexpr double kTurned = 5;
/// Cosine of the angle within which axes are the same; the most sets of axes that are tried.
const double kAligned = std::cos(kTurned * kDegree);
constexpr std::size_t kMostAxes = kBeam / 2;

/// Part of its area by which a facet may differ from the one that it is brought onto.
constexpr double kSameArea = 0.05;

/// The point of a part that its symmetries leave where it is.
Eigen::Vector3d MiddleOf(const Box& box) {
  if (!box.mesh) return box.structure_from_box.translation();
  return box.structure_from_box * Eigen::Vector3d(box.MeshScale() * box.mesh->centroid());
}

/// Does the motion bring every vertex of one part near the surface of the other?
bool BringsVerticesOnto(const Pose& motion, const Box& from, const Box& to) {
  const Structure other = Structure::FromBoxes("", {to});
  const std::vector<Eigen::Vector3d> vertices = from.Vertices();
  return std::all_of(vertices.begin(), vertices.end(), [&](const Eigen::Vector3d& p) {
    return DistanceToSurface(other, motion * p).distance < kSamePlace;
  });
}

/// Does the motion bring one part onto the other? Of boxes: every corner near some corner.
bool BringsOnto(const Pose& motion, const Box& from, const Box& to) {
  if (from.mesh || to.mesh) {
    return BringsVerticesOnto(motion, from, to) && BringsVerticesOnto(motion.inverse(), to, from);
  }
  const auto corners = from.Corners(), there = to.Corners();
  return std::all_of(corners.begin(), corners.end(), [&](const Eigen::Vector3d& p) {
    return std::any_of(there.begin(), there.end(), [&](const Eigen::Vector3d& q) {
      return (motion * p - q).norm() < kSamePlace;
    });
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

void AddTurn(const Eigen::Matrix3d& turn, std::vector<Eigen::Matrix3d>* turns) {
  AddIfNew(turn, turns, [&](const Eigen::Matrix3d& other) {
    return (other.transpose() * turn).trace() > 1 + 2 * kAligned;
  });
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
        AddTurn(turn, &turns);
      }
    }
  }
  return turns;
}

/// Unit axes of which the first is along `a` and the second in the plane of `a` and `b`.
Eigen::Matrix3d AxesAlong(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  Eigen::Matrix3d axes;
  axes.col(0) = a;
  axes.col(1) = (b - b.dot(a) * a).normalized();
  axes.col(2) = axes.col(0).cross(axes.col(1));
  return axes;
}

/// Adds the turns that bring a mesh's largest facet, and the largest of those that do not face
/// along the same line, onto two others alike.
void AddTurnsOfFacets(const Box& box, std::vector<Eigen::Matrix3d>* turns) {
  std::vector<const Facet*> flat;
  for (const Facet& facet : box.mesh->facets())
    if (facet.flat) flat.push_back(&facet);
  SortLargestFirst(&flat, [](const Facet* facet) { return facet->outline->area; });
  if (flat.empty()) return;
  const auto aside = std::find_if(flat.begin(), flat.end(), [&](const Facet* facet) {
    return std::abs(facet->normal.dot(flat.front()->normal)) < kFacesAlike;
  });
  if (aside == flat.end()) return;
  const auto is_like = [](const Facet* a, const Facet* b) {
    return std::abs(a->outline->area - b->outline->area) < kSameArea * a->outline->area;
  };
  const Eigen::Vector3d &first = flat.front()->normal, &second = (*aside)->normal;
  const Eigen::Matrix3d own = box.structure_from_box.linear();
  for (const Facet* a : flat) {
    if (!is_like(flat.front(), a)) continue;
    for (const Facet* b : flat) {
      if (!is_like(*aside, b) ||
          std::abs(a->normal.dot(b->normal) - first.dot(second)) > 1 - kAligned)
        continue;
      const Eigen::Matrix3d turn = own * AxesAlong(a->normal, b->normal) *
                                   AxesAlong(first, second).transpose() * own.transpose();
      AddTurn(turn, turns);
    }
  }
}

/// Boxes that the motion brings onto a box; 0 if they are less than half. `middles`: of the boxes.
int CountMoved(const std::vector<Box>& boxes, const KdTree& middles, const Pose& motion) {
  std::size_t moved = 0;
  for (std::size_t i = 0; i < boxes.size(); ++i) {
    if (2 * (i - moved) > boxes.size()) return 0;
    const Eigen::Vector3d middle = motion * MiddleOf(boxes[i]);
    const int onto = middles.Nearest(middle, 2 * kSamePlace).index;
    if (onto >= 0 && BringsOnto(motion, boxes[i], boxes[static_cast<std::size_t>(onto)])) ++moved;
  }
  return 2 * moved < boxes.size() ? 0 : static_cast<int>(moved);
}

}  // namespace

std::vector<StructureSymmetry> FindSymmetries(const Structure& structure) {
  const std::vector<Box>& boxes = structure.boxes();
  std::vector<Eigen::Vector3d> points;
  for (const Box& box : boxes) points.push_back(MiddleOf(box));
  const KdTree middles(std::move(points));
  std::vector<StructureSymmetry> symmetries;
  std::vector<Eigen::Matrix3d> turns = TurnsBetween(boxes);
  for (const Box& box : boxes)
    if (box.mesh) AddTurnsOfFacets(box, &turns);
  for (const Eigen::Matrix3d& turn : turns) {
    const std::size_t first = symmetries.size();
    for (const Box& from : boxes) {
      for (const Box& to : boxes) {
        StructureSymmetry symmetry;
        symmetry.motion.linear() = turn;
        symmetry.motion.translation() = MiddleOf(to) - turn * MiddleOf(from);
        const auto same = [&](const StructureSymmetry& other) {
          return (other.motion.translation() - symmetry.motion.translation()).norm() < kSameMotion;
        };
        const bool identity =
            turn.trace() > 1 + 2 * kAligned && symmetry.motion.translation().norm() < kSameMotion;
        if (identity || !BringsOnto(symmetry.motion, from, to) ||
            std::any_of(symmetries.begin() + static_cast<std::ptrdiff_t>(first), symmetries.end(),
                        same))
          continue;
        symmetry.boxes = CountMoved(boxes, middles, symmetry.motion);
        if (symmetry.boxes == 0) continue;
        symmetries.push_back(std::move(symmetry));
      }
    }
  }
  SortLargestFirst(&symmetries, [](const StructureSymmetry& symmetry) { return symmetry.boxes; });
  return symmetries;
}

bool SamePose(const Structure& structure, const Pose& a, const Pose& b) {
  const Pose motion = b * a.inverse();
  double edge = kMostStep / kPartOfEdge;
  for (const Box& box : structure.boxes()) edge = std::min(edge, box.size.minCoeff());
  const double step = std::max(kPartOfEdge * edge, kLeastStep);
  for (const Box& box : structure.boxes()) {
    for (const Eigen::Vector3d& corner : box.Corners()) {
      if (!((motion * corner - corner).norm() <= step)) return false;
    }
  }
  return true;
}

bool TurnsOver(const Pose& from, const Pose& to) {
  return (to * from.inverse()).linear()(1, 1) <= kFacesAlike;
}

bool LeavesFloor(const Pose& from, const Pose& to) {
  return TurnsOver(from, to) || std::abs((to * from.inverse()).translation().y()) > kSameMotion;
}

std::string DescribeMotion(const Pose& from, const Pose& to) {
  const Pose motion = to * from.inverse();
  if (motion.linear()(1, 1) < -kFacesAlike) return "upside down";
  if (TurnsOver(from, to)) return "laid on another side";
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
