#pragma once

// Measures whether a stack of boxes is a good target, by its shape alone.

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

/// The stack as a sensor (320 x 288 pixels, 75 x 65 deg) sees it that looks at its middle.
struct TargetView {
  double phi_deg = 0;           ///< azimuth, from +x towards +z, as of a rig's sensors
  double height_m = 0;          ///< above the floor
  int sides = 0;                ///< with enough pixels to be used
  bool sides_fix_pose = false;  ///< SidesFixPose
  /// Standard deviation of the position in its least known direction, m; infinite where it is open.
  /// It assumes independent errors: 5 mm per patch of 10 x 10 pixels, and one pixel per 10 pixels
  /// of a silhouette.
  double weakest_m = 0;
  /// Indices of the symmetries (StructureSymmetry) that look alike from there. At least 95 % of the
  /// pixels on the stack from either pose then have the same depth, to 2 cm.
  std::vector<int> look_alike;
};

struct TargetSymmetry {
  std::string motion;        ///< "turned by 180 deg"
  int boxes = 0;             ///< number of boxes that it moves onto boxes
  bool all = false;          ///< of them
  bool floor_tells = false;  ///< it leaves the floor: a seen floor tells it apart
};

struct TargetQuality {
  std::vector<TargetSymmetry> symmetries;
  std::vector<TargetView> views;  ///< height by height, in order of directions
  TargetViewOptions options;
};

/// Measures views from all directions and heights. `count` is called with the number of views done.
TargetQuality MeasureTarget(const Structure& structure, const TargetViewOptions& options = {},
                            const CountDone& count = {});

}  // namespace volalign
