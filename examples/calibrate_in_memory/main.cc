// Calibrates three sensors from depth buffers in memory and prints where they stand. The buffers
// are computed here; a program has them from its sensors.

#include <cmath>
#include <iostream>
#include <string>
#include <vector>

#include "core/geometry/lens.h"
#include "core/geometry/visibility.h"
#include "infer/calib/calibrate.h"

int main() {
  using namespace volalign;
  // A stack of two boxes, in metres; y is up. The room that the sensors see has a floor besides.
  std::vector<Box> boxes = {Box::FromMinMax("low", {-0.3, 0, -0.2}, {0.3, 0.4, 0.2}),
                            Box::FromMinMax("high", {-0.3, 0.4, -0.15}, {0.1, 0.75, 0.2})};
  const Structure stack = Structure::FromBoxes("stack", boxes);
  boxes.push_back(Box::FromMinMax("floor", {-5, -0.1, -5}, {5, 0, 5}));
  const Structure room = Structure::FromBoxes("room", boxes);
  std::vector<SensorFrame> frames;
  for (const double angle : {0.5, 2.4, 4.3}) {
    SensorFrame frame;
    frame.name = "sensor" + std::to_string(frames.size());
    frame.intrinsics.width = 320;
    frame.intrinsics.height = 288;
    frame.intrinsics.fx = frame.intrinsics.fy = 252;
    frame.intrinsics.cx = 159.5;
    frame.intrinsics.cy = 143.5;
    const Pose pose = LookAt({2 * std::cos(angle), 1.1, 2 * std::sin(angle)}, {0, 0.4, 0}, 0);
    frame.depth = CastView(room, ComputeRays(frame.intrinsics), pose).depth;  // m, row by row
    frames.push_back(frame);
  }
  // No network: the first poses come from the shape of the stack.
  const CalibrationResult result = Calibrate({{"", frames}}, stack, nullptr);
  for (const FrameResult& sensor : result.sensors) {
    std::cout << sensor.name << ": " << ToString(sensor.status) << " " << sensor.reason << "\n";
    if (sensor.structure_from_sensor) std::cout << sensor.structure_from_sensor->matrix() << "\n";
  }
  return result.verdict() == SensorStatus::kOk ? 0 : 1;
}
