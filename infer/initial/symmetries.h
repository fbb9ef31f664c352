#pragma once

#include <string>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/view/alike.h"

namespace volalign {

/// A motion that brings at least half of a structure's boxes onto boxes of the structure, to 2 cm.
/// The paper's stack has two kinds. Half a turn about a horizontal diagonal moves every box onto a
/// box. A step of its spiral, a quarter turn and one box higher or lower, moves all but one. Where
/// a view does not show the rest, the shape cannot tell a pose from motion * pose.
struct StructureSymmetry {
  Pose motion = Pose::Identity();  ///< in the structure frame
  int boxes = 0;                   ///< number of boxes that it brings onto a box
  bool keeps_up() const { return motion.linear()(1, 1) > kFacesAlike; }
};

/// Every such motion except the identity. Motions that move the most boxes onto boxes come first.
std::vector<StructureSymmetry> FindSymmetries(const Structure& structure);

/// Are these estimates of about the same pose? The motion between them then moves no corner of the
/// structure by more than half of its smallest edge, limited to 3 to 20 cm. Steps and turns that
/// make a structure look alike move it farther.
bool SamePose(const Structure& structure, const Pose& a, const Pose& b);

/// Does one of two poses of a sensor turn the structure over?
bool TurnsOver(const Pose& from, const Pose& to);

/// Does the structure stand on another floor at `to` than at `from`?
bool LeavesFloor(const Pose& from, const Pose& to);

/// Describes how the structure stands at `to` as compared with `from`, as in "upside down", "turned
/// by 90 deg and 0.41 m higher" or "shifted by 0.30 m".
std::string DescribeMotion(const Pose& from, const Pose& to);

}  // namespace volalign
