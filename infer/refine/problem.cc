#include "infer/refine/problem.h"

#include <algorithm>
#include <map>

namespace volalign::refine_internal {

namespace {

/// With one more, that is known, where a sensor needs it.
std::vector<SensorLens> WithKnownLens(std::vector<SensorLens> lenses,
                                      const std::vector<RefineSensor>& sensors) {
  if (std::any_of(sensors.begin(), sensors.end(), [](const auto& s) { return s.lens < 0; }))
    lenses.emplace_back();
  return lenses;
}

/// `known_lens`: index of the one that is known. Sensors are numbered as they first occur.
std::vector<FrameOf> FramesOf(const std::vector<RefineSensor>& sensors, std::size_t known_lens) {
  std::vector<FrameOf> frames;
  frames.reserve(sensors.size());
  std::map<int, int> numbers;
  int count = 0;
  for (const RefineSensor& sensor : sensors) {
    FrameOf of;
    of.still = sensor.still;
    of.lens = sensor.lens < 0 ? static_cast<int>(known_lens) : sensor.lens;
    of.sensor = count;
    if (sensor.sensor >= 0) of.sensor = numbers.emplace(sensor.sensor, count).first->second;
    count = std::max(count, of.sensor + 1);
    frames.push_back(of);
  }
  return frames;
}

}  // namespace

JointProblem::JointProblem(const Structure& structure_in,
                           const std::vector<RefineSensor>& sensors_in,
                           const RefineOptions& options_in,
                           const std::vector<SensorLens>& lenses_in, std::size_t stills)
    : structure(structure_in),
      sensors(sensors_in),
      options(options_in),
      model(structure_in),
      priors(refine_internal::PriorsOf(options_in)),
      lenses(WithKnownLens(lenses_in, sensors_in)),
      frames(FramesOf(sensors_in, lenses_in.size())),
      layout(frames, stills, structure_in.boxes().size(), lenses.size()) {
  for (const RefineSensor& sensor : sensors)
    overlap_points.push_back(
        ChooseOverlapPoints(structure, *sensor.points, sensor.start, options.max_overlap_points));
}

bool JointProblem::OverlapCounts(std::size_t a, std::size_t b) const {
  if (options.max_overlap_points == 0 || a == b || frames[a].still != frames[b].still) return false;
  const auto is_in = [&](int sensor, int still) {
    return std::any_of(frames.begin(), frames.end(), [&](const FrameOf& frame) {
      return frame.sensor == sensor && frame.still == still;
    });
  };
  for (int still = 0; still < frames[a].still; ++still) {
    if (is_in(frames[a].sensor, still) && is_in(frames[b].sensor, still)) return false;
  }
  return true;
}

}  // namespace volalign::refine_internal
