#pragma once

// Does a sensor contradict what all sensors together make of the structure? Not for callers of
// Refine.

#include <optional>
#include <vector>

#include "infer/refine/fine.h"
#include "infer/refine/problem.h"

namespace volalign::refine_internal {

/// What a sensor's own measurements lose by the joint solution.
struct Disagreement {
  /// Half the square, in standard deviations, of the way from the joint solution to the one that
  /// its own measurements and the priors make most probable.
  double cost = 0;
  /// m, of its observations of faces at the joint solution, and at its own.
  double rms_together = 0, rms_alone = 0;
  Matrix6d covariance = Matrix6d::Zero();  ///< of its pose, by its own measurements
};
/// Of a sensor that takes part in the solution, by a linear approximation. What is not in
/// `asked_for` is as it is in the solution.
Disagreement MeasureDisagreement(const JointProblem& problem, const Solution& solution,
                                 const FreeSet& asked_for, std::size_t sensor);

/// Is it more than the noise of both would make?
bool Disagrees(const Disagreement& disagreement);

/// What a sensor that was set aside would have had to accept.
struct SetAside {
  Pose together;  ///< its pose in the joint solution with it
  Disagreement disagreement;
};
struct Agreed {
  Solution solution;                        ///< of the sensors that agree
  std::vector<std::optional<SetAside>> of;  ///< of each sensor; nothing where it agrees
};
/// Sets aside, one after the other, the sensor that disagrees most: it stays at its start pose, and
/// the others are solved again without its evidence, beginning with everything in `asked_for` free.
/// Takes at least three sensors, as between two nothing tells which one is wrong, and leaves a
/// majority.
Agreed SetAsideDisagreeing(const JointProblem& problem, const FreeSet& asked_for,
                           Solution solution);

}  // namespace volalign::refine_internal
