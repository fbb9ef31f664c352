// Calibrates a capture without a network and prints where its sensors stand:
// calibrate_capture capture.json boxes.yaml

#include <exception>
#include <iomanip>
#include <iostream>

#include "infer/calib/calibrate.h"
#include "infer/capture/capture.h"

int main(int argc, char** argv) {
  using namespace volalign;
  if (argc != 3) {
    std::cerr << "usage: calibrate_capture capture.json boxes.yaml\n";
    return 1;
  }
  try {
    const CalibrationResult result =
        Calibrate({{"", ReadCapture(argv[1]).sensors}}, ReadStructure(argv[2]), nullptr);
    std::cout << std::setprecision(17);
    for (const FrameResult& sensor : result.sensors) {
      std::cout << sensor.name << ": " << ToString(sensor.status) << " " << sensor.reason << "\n";
      if (sensor.structure_from_sensor) std::cout << sensor.structure_from_sensor->matrix() << "\n";
    }
    return result.verdict() == SensorStatus::kFailed ? 2 : 0;
  } catch (const std::exception& error) {
    std::cerr << "error: " << error.what() << "\n";
    return 1;
  }
}
