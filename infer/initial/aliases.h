#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/view/alike.h"

namespace volalign {

/// A motion that brings at least half of a structure's boxes onto boxes of the structure, to 2 cm.
/// The paper's stack has two kinds: half a turn about a horizontal diagonal, which moves every box
/// onto a box, and steps of its spiral, a quarter turn and one box higher or lower, which moves all
/// but one. Where a view does not show the rest, the structure's shape cannot tell a pose from its
/// alias, alias.motion * pose.
struct StructureAlias {
  Pose motion = Pose::Identity();         ///< of the structure, in its own frame
  std::vector<std::uint8_t> label_after;  ///< of a side after the motion, by its label; 0: of none
  int boxes = 0;                          ///< that come to lie on a box
  bool keeps_up() const { return motion.linear()(1, 1) > kFacesAlike; }
};

/// Every such motion except the identity, those that move the most boxes onto boxes first.
std::vector<StructureAlias> FindAliases(const Structure& structure);

/// Does the structure stand on another floor at `to` than at `from`?
bool LeavesFloor(const Pose& from, const Pose& to);

/// How the structure stands at `to` as compared with `from`: "upside down", "turned by 90 deg and
/// 0.41 m higher", "turned by 180 deg", "0.30 m beside".
std::string DescribeMotion(const Pose& from, const Pose& to);

}  // namespace volalign
