#pragma once

// Does a sensor contradict the solution of all sensors? Not for callers of Refine.

#include <optional>
#include <vector>

#include "infer/refine/posterior.h"
#include "infer/refine/prior_scales.h"
#include "infer/refine/problem.h"
#include "infer/refine/refine.h"
#include "infer/refine/solution.h"

namespace volalign::refine_internal {

/// The part of a solution's quadratic cost that a frame's own measurements make, without priors.
struct OwnMeasurements {
  std::vector<Eigen::Index> columns;  ///< ParameterLayout::ColumnsOf
  NormalEquations normal;             ///< over these columns
};
OwnMeasurements MeasurementsOf(const JointProblem& problem, const Solution& solution,
                               std::size_t frame);

/// Degrees of freedom of a frame's own variance factor beside that of all frames. Frames of another
/// simulator: 17 by all their numbers, 9 by their poses. With 10, a focal length 6 % off is hidden.
inline constexpr double kNoiseFreedom = 15;

/// How far some numbers that a frame measured are from their prediction.
struct Innovation {
  double cost = 0;  ///< half the square, in standard deviations of measurement and prediction
  std::size_t predicted = 0;  ///< number of independent measurements in the sum

  /// Is the cost larger than a variable with the F distribution, at three sigmas of a normal one?
  /// Paulson, "An Approximate Normalization of the Analysis of Variance Distribution", 1942.
  /// `freedom`: see kNoiseFreedom; infinite if the variance factor is known.
  bool IsUnlikely(double freedom = kNoiseFreedom) const;
};
/// How far a frame's own measurements are from the prediction by all others and the priors.
struct Disagreement : Innovation {
  /// The part that goes if nothing else predicts the frame's pose. It shows a movement, which is
  /// lost among all the frame's numbers.
  Innovation of_pose;

  bool Disagrees() const { return IsUnlikely() || of_pose.IsUnlikely(); }
};
/// The disagreement by a linear approximation. `predicted`: the normal equations of the other
/// frames and the priors, over all parameters. `priors`: of the same solution. A parameter that
/// only its prior determines is no prediction. Constant parameters keep their values. Zero if it
/// cannot be computed.
Disagreement DisagreementOf(const OwnMeasurements& own, const NormalEquations& predicted,
                            const QuadraticCost& priors, const std::vector<char>& constant);

/// The result for an excluded frame.
struct ExcludedFrame : RefusedFit {
  State alone;          ///< what its own measurements and the priors make most probable
  Matrix6d covariance;  ///< of its pose in that
};
struct Agreed {
  Solution solution;                             ///< of the frames that agree
  std::vector<std::optional<ExcludedFrame>> of;  ///< of each frame; nothing where it agrees
  /// Each frame's, in the last solution that it took part in. Costs are divided by the variance
  /// factor of all frames.
  std::vector<Disagreement> measured;
};
/// Excludes, one after the other, the frame that disagrees most. It stays where its own
/// measurements have it. The others are solved again without its observations, beginning with
/// everything in `asked_for` free. A frame that cannot be solved alone stays. A majority of the
/// sensors stays, or a majority of a sensor's frames if it has three or more. Between two, it is
/// unknown which one is wrong. A frame that is only unusual (a known variance factor makes it
/// unlikely) is excluded, too, if its sensor has another frame, which then places the sensor
/// better.
///
/// The test leaves the boxes and their size as free as their priors allow, even if `asked_for`
/// fixes them. The solution then fixes them again. If both priors are zero, the test fixes them,
/// too.
Agreed ExcludeDisagreeing(const JointProblem& problem, const FreeSet& asked_for, Solution solution);

}  // namespace volalign::refine_internal
