#pragma once

#include <vector>

#include "core/base/image.h"
#include "core/geometry/structure.h"
#include "infer/calib/result.h"

namespace volalign {

/// m: residual at the ends of the colour scale.
inline constexpr double kResidualScale = 0.02;

/// The SideResiduals of one side, of less than 10 cm.
struct SideFit {
  int label = 0;
  int points = 0;
  double mean_m = 0, rms_m = 0;
};

/// The four pictures of a frame, upright. `edges` is empty without a pose or a best guess,
/// `residual` without a pose.
struct FramePanels {
  RgbImage depth;   ///< as measured, coloured between near_m and far_m; black: no measurement
  RgbImage labels;  ///< as predicted, over shaded depth
  RgbImage edges;   ///< of the structure as found, seen from the pose or best guess, over the depth
  RgbImage residual;  ///< of labelled pixels, SignedColour up to kResidualScale
  double near_m = 0, far_m = 0;
  std::vector<int> shown_labels;  ///< in `labels`, ascending
  std::vector<SideFit> sides;     ///< of every side with points, by label
};

/// Signed distance of each labelled point from the plane of its side, m: positive outside the box
/// (measured too near), negative inside. NaN for pixels without depth or without a side's label,
/// and without a pose.
Image<float> SideResiduals(const FrameResult& sensor, const Structure& structure);

/// The depth panel with the structure's edges as seen from a pose.
RgbImage EdgesPanel(const FrameResult& sensor, const Structure& structure,
                    const Pose& structure_from_sensor, int turns);

/// Makes the panels of a frame. `turns`: clockwise quarter turns that bring it upright. Frames of
/// over 480 pixels are shown at every second, third ... pixel.
FramePanels MakePanels(const FrameResult& sensor, const Structure& structure, int turns);

/// The clockwise quarter turns that bring each sensor's frame upright. A sensor without a pose is
/// turned like most of the others.
std::vector<int> UprightTurnsOf(const std::vector<FrameResult>& sensors);

/// Converts 0 to 1 into 0 to 255.
LabelImage ConfidenceImage(const Image<float>& confidence);

/// A frame's panels side by side under the sensor's name, status and figures. Each has its caption
/// and its scale. `caption_labels`: with a legend of the sides' colours below.
RgbImage SensorPicture(const SensorOutcome& sensor, const FramePanels& panels,
                       const Structure& structure, bool caption_labels);

/// The sensors' pictures, and one legend of the sides' colours below them all.
RgbImage OverviewPicture(const std::vector<RgbImage>& pictures, const Structure& structure);

}  // namespace volalign
