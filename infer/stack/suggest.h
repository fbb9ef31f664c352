#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "core/base/progress_line.h"
#include "core/geometry/structure.h"
#include "infer/initial/target_quality.h"

namespace volalign {

/// Parses sizes of boxes, m, from "3x 600x400x400, 2x 400x300x250": a number of boxes (1 if left
/// out) and three edges in mm, in any order. Throws DataError naming the part that it cannot read.
std::vector<Eigen::Vector3d> ParseBoxes(const std::string& text);

struct SuggestOptions {
  double height_m = 2;   ///< of the stack, at most
  int candidates = 40;   ///< stacks that are drawn and measured
  double tilt_deg = 10;  ///< that the stack has to bear in every direction; IEC 60950-1, 4.1
  int threads = 1;
};

struct SuggestedStack {
  Structure structure;
  TargetQuality quality;
  double tilt_deg = 0;  ///< that it bears, if all boxes have one density
};

/// Suggests a tower of these boxes, the larger ones below, that fixes poses well and looks like
/// itself from one way only. Towers that bear the tilt are drawn at random: the upright edge of a
/// box, its turn on the one below, and overhangs in whole cm. MeasureTarget compares them by four
/// numbers. The first is the number of views that another pose shares though the floor is seen.
/// Then come the views that fix no pose, and those that another pose shares without the floor. The
/// last is the standard deviation in the worst view. Equal calls give equal stacks. The origin is
/// above the middle of the lowest box, half as high as the stack. `count` is called with the number
/// of towers done. Throws DataError if the boxes are higher than `height_m` even if all lie flat,
/// are more than kMaxBoxes, or if no tower bears the tilt.
SuggestedStack SuggestStack(const std::string& name, const std::vector<Eigen::Vector3d>& sizes,
                            const SuggestOptions& options = {}, const CountDone& count = nullptr);

/// The angle, deg, by which the floor may be tilted before a tower of boxes with level sides tips
/// over one of its joints. Every box stands on the one before it.
double TiltOfTower(const std::vector<Box>& boxes);

}  // namespace volalign
