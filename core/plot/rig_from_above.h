#pragma once

#include <Eigen/Core>
#include <string>
#include <utility>
#include <vector>

#include "core/geometry/camera.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"

namespace volalign {

/// A sensor as RigFromAbove draws it.
struct SensorFromAbove {
  std::string name;
  std::string note;    ///< a line below the name
  std::string title;   ///< appears where a pointer rests
  std::string colour;  ///< of SVG
  Intrinsics intrinsics;
  Pose structure_from_sensor = Pose::Identity();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< of its position, m^2
};

/// Okabe and Ito's colours, which people with any colour vision can distinguish.
inline constexpr char kBlue[] = "#0072b2", kOrange[] = "#e69f00", kVermilion[] = "#d55e00";

/// The legend below the drawing: colours and their words, then a line.
struct LegendFromAbove {
  std::vector<std::pair<std::string, std::string>> colours;
  std::string line;
};

/// A rig from above as SVG. It has the stack, the sensors, axes and a scale. Each sensor has its
/// view of the horizontal plane through itself, up to the stack's far side. Its ellipse is two
/// standard deviations of its position, enlarged 20 times. Classes and rules are named rig-, so
/// that a page may contain it.
std::string RigFromAbove(const Structure& structure, const std::vector<SensorFromAbove>& sensors,
                         const LegendFromAbove& legend);

}  // namespace volalign
