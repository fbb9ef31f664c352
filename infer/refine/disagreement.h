#pragma once

// Does a sensor contradict what all sensors together make of the structure? Not for callers of
// Refine.

#include <optional>
#include <vector>

#include "infer/refine/posterior.h"
#include "infer/refine/prior_scales.h"
#include "infer/refine/problem.h"
#include "infer/refine/solution.h"

namespace volalign::refine_internal {

/// What a frame's own measurements say, about a solution: a part of its quadratic cost, without
/// priors.
struct OwnMeasurements {
  std::vector<Eigen::Index> columns;  ///< ParameterLayout::ColumnsOf
  Eigen::MatrixXd information;        ///< J^T J, over these columns
  Eigen::VectorXd gradient;           ///< J^T r
};
OwnMeasurements MeasurementsOf(const JointProblem& problem, const Solution& solution,
                               std::size_t frame);

/// How far a frame's own measurements are from what all others and the priors predict of them.
struct Disagreement {
  /// Half the square, in standard deviations of measurement and prediction.
  double cost = 0;
  std::size_t predicted = 0;  ///< of how many independent numbers it is the sum
};
/// By a linear approximation. `predicted`: what others and the priors say of all parameters.
/// `priors`: of the same solution. A parameter of which only its prior tells is no number that is
/// predicted. What is constant is as it is in the solution. Zero where it cannot be computed.
Disagreement Innovation(const OwnMeasurements& own, const NormalEquations& predicted,
                        const QuadraticCost& priors, const std::vector<char>& constant);

/// What Disagreement::cost exceeds by chance in one of a thousand: half a chi-square (approximated
/// as Wilson and Hilferty have it, "The Distribution of Chi-Square", 1931).
double UnlikelyCost(std::size_t predicted);

/// Is it more than the noise of measurement and prediction would make?
bool Disagrees(const Disagreement& disagreement);

/// What a frame that was set aside would have had to accept.
struct SetAside {
  Pose together;                 ///< its pose in the joint solution with it
  std::vector<int> contradicts;  ///< the frames that show it, the clearest first
  State alone;                   ///< what its own measurements and the priors make most probable
  Matrix6d covariance;           ///< of its pose in that
};
struct Agreed {
  Solution solution;                        ///< of the frames that agree
  std::vector<std::optional<SetAside>> of;  ///< of each frame; nothing where it agrees
  /// Of each frame, in the last solution that it took part in. Costs are divided by the variance
  /// factor of all frames.
  std::vector<Disagreement> measured;
};
/// Sets aside, one after the other, the frame that disagrees most: it stays where its own
/// measurements have it, and the others are solved again without its observations, beginning with
/// everything in `asked_for` free. Takes at least three sensors, as between two nothing tells which
/// one is wrong, and leaves a majority of those that take part; or, of a sensor of three frames or
/// more, most of its frames. One that cannot be solved alone stays.
///
/// Whether sensors saw one stack is asked with the boxes and their size free, as far as their
/// priors leave them open, also where `asked_for` holds them; the solution then holds them still.
/// Where both priors are zero, sensors cannot have seen different stacks, and none is set aside.
Agreed SetAsideDisagreeing(const JointProblem& problem, const FreeSet& asked_for,
                           Solution solution);

}  // namespace volalign::refine_internal
