#include "infer/refine/problem.h"

#include <algorithm>

namespace volalign::refine_internal {

namespace {

/// With one more, that is known, where a sensor needs it.
std::vector<SensorLens> WithKnownLens(std::vector<SensorLens> lenses,
                                      const std::vector<RefineSensor>& sensors) {
  if (std::any_of(sensors.begin(), sensors.end(), [](const auto& s) { return s.lens < 0; }))
    lenses.emplace_back();
  return lenses;
}

std::vector<int> LensesOf(const std::vector<RefineSensor>& sensors, std::size_t given) {
  std::vector<int> lens_of;
  lens_of.reserve(sensors.size());
  for (const RefineSensor& sensor : sensors)
    lens_of.push_back(sensor.lens < 0 ? static_cast<int>(given) : sensor.lens);
  return lens_of;
}

}  // namespace

JointProblem::JointProblem(const Structure& structure_in,
                           const std::vector<RefineSensor>& sensors_in,
                           const RefineOptions& options_in,
                           const std::vector<SensorLens>& lenses_in)
    : structure(structure_in),
      sensors(sensors_in),
      options(options_in),
      model(structure_in),
      priors(refine_internal::PriorsOf(options_in)),
      lenses(WithKnownLens(lenses_in, sensors_in)),
      lens_of(LensesOf(sensors_in, lenses_in.size())),
      layout(sensors_in.size(), structure_in.boxes().size(), lenses.size()) {
  for (const RefineSensor& sensor : sensors)
    overlap_points.push_back(
        ChooseOverlapPoints(structure, *sensor.points, sensor.start, options.max_overlap_points));
}

}  // namespace volalign::refine_internal
