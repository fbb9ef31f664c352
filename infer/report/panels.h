#pragma once

#include <vector>

#include "core/base/image.h"
#include "core/geometry/structure.h"
#include "infer/calib/result.h"

namespace volalign {

/// m: residuals of this size and more have the ends of the colour scale.
inline constexpr double kResidualScale = 0.02;

/// How far a sensor's points of a side lie from it, SideResiduals of less than 10 cm.
struct SideFit {
  int label = 0;
  int points = 0;
  double mean_m = 0, rms_m = 0;
};

/// The four ways in which a frame is shown, upright. `edges` and `residual` are empty without a
/// pose.
struct FramePanels {
  RgbImage depth;     ///< as measured, coloured between near_m and far_m; black: no measurement
  RgbImage labels;    ///< as predicted, over shaded depth
  RgbImage edges;     ///< of the structure as found, seen from the pose, over the depth
  RgbImage residual;  ///< of labelled pixels, SignedColour up to kResidualScale
  double near_m = 0, far_m = 0;
  std::vector<int> shown_labels;  ///< in `labels`, ascending
  std::vector<SideFit> sides;     ///< of every side with points, by label
};

/// Where a labelled point lies to the plane of its side, m: positive outside the box (measured too
/// near), negative inside. NaN for pixels without depth or without a side's label, and without a
/// pose.
Image<float> SideResiduals(const FrameResult& sensor, const Structure& structure);

/// The depth panel with the structure's edges as they are seen from a pose.
RgbImage EdgesPanel(const FrameResult& sensor, const Structure& structure,
                    const Pose& structure_from_sensor, int turns);

/// `turns`: clockwise quarter turns that bring the frame upright. Frames of over 480 pixels are
/// shown at every second, third ... pixel.
FramePanels MakePanels(const FrameResult& sensor, const Structure& structure, int turns);

/// The turns that bring each sensor's frame upright. One without a pose is shown as most of the
/// others are mounted.
std::vector<int> UprightTurnsOf(const std::vector<FrameResult>& sensors);

}  // namespace volalign
