#include "infer/view/frames.h"

#include <algorithm>

namespace volalign {

CaptureSet::CaptureSet(std::vector<Capture> captures_in, Structure structure_in)
    : captures(std::move(captures_in)), structure(std::move(structure_in)) {
  std::vector<std::vector<std::size_t>> numbers;
  for (const Capture& capture : captures) {
    std::vector<std::size_t>& of_capture = numbers.emplace_back();
    for (const SensorFrame& frame : capture.frames) {
      const auto known = std::find(sensors.begin(), sensors.end(), frame.name);
      of_capture.push_back(static_cast<std::size_t>(known - sensors.begin()));
      if (known == sensors.end()) sensors.push_back(frame.name);
    }
  }
  sensor_of = PerFrame<std::size_t>(std::move(numbers));
}

}  // namespace volalign
