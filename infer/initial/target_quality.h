#pragma once

// Whether a stack of boxes is a good target, by its shape alone.

#include <string>
#include <vector>

#include "core/base/progress_line.h"
#include "core/geometry/structure.h"

namespace volalign {

struct TargetViewOptions {
  double distance_m = 2;  ///< horizontal, from the middle of the stack
  std::vector<double> heights_m = {0.5, 1.0, 1.5, 2.0};  ///< above the floor
  int directions = 36;                                   ///< about the vertical
};

/// What a sensor (320 x 288 pixels, 75 x 65 deg) that looks at the stack's middle would see of it.
struct TargetView {
  double phi_deg = 0;           ///< about the vertical from +x towards +z, as a rig's sensors
  double height_m = 0;          ///< above the floor
  int sides = 0;                ///< with enough pixels to be used
  bool sides_fix_pose = false;  ///< SidesFixPose
  /// Standard deviation of the position in the direction that the view tells least about, m, for
  /// independent errors of 5 mm of patches of 10 x 10 pixels, and of a pixel of every 10 pixels of
  /// its silhouettes; infinite where it is open.
  double weakest_m = 0;
  /// Indices of the aliases (StructureAlias) that look alike from there: at least 95 % of the
  /// pixels on the stack from either pose have the same depth, to 2 cm.
  std::vector<int> look_alike;
};

struct TargetAlias {
  std::string motion;        ///< "turned by 180 deg"
  int boxes = 0;             ///< that it moves onto boxes
  bool all = false;          ///< of them
  bool floor_tells = false;  ///< it leaves the floor, which tells it apart where the floor is seen
};

struct TargetQuality {
  std::vector<TargetAlias> aliases;
  std::vector<TargetView> views;  ///< height by height, in order of directions
  TargetViewOptions options;
};

/// `count` is told how many of the views are done.
TargetQuality MeasureTarget(const Structure& structure, const TargetViewOptions& options = {},
                            const CountDone& count = {});

}  // namespace volalign
