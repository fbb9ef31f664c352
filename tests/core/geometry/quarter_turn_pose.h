#pragma once

#include "core/geometry/pose.h"

namespace volalign {

/// sensor_from_turned: the turned image (core/base/image.h, Turn) sees the scene through a sensor
/// that is rotated about the optical axis; p_sensor = QuarterTurnPose(k) * p_turned.
inline Pose QuarterTurnPose(int quarter_turns) {
  // One clockwise turn of the image sends +x to +y: the turned image's x axis is the sensor's -y,
  // its y the sensor's +x.
  const int turns = ((quarter_turns % 4) + 4) % 4;
  Eigen::Matrix3d one;
  one << 0, 1, 0,  //
      -1, 0, 0,    //
      0, 0, 1;
  Pose pose = Pose::Identity();
  for (int i = 0; i < turns; ++i) pose.linear() = one * pose.linear();
  return pose;
}

}  // namespace volalign
