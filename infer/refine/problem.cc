#include "infer/refine/problem.h"

namespace volalign::refine_internal {

JointProblem::JointProblem(const Structure& structure_in,
                           const std::vector<RefineSensor>& sensors_in,
                           const RefineOptions& options_in)
    : structure(structure_in),
      sensors(sensors_in),
      options(options_in),
      model(structure_in),
      priors(PriorsOf(options_in)),
      layout(sensors_in.size(), structure_in.boxes().size()) {
  for (const RefineSensor& sensor : sensors)
    overlap_points.push_back(
        ChooseOverlapPoints(structure, *sensor.points, sensor.start, options.max_overlap_points));
}

}  // namespace volalign::refine_internal
