#pragma once

// Does a sensor contradict what all sensors together make of the structure? Not for callers of
// Refine.

#include <optional>
#include <vector>

#include "infer/refine/problem.h"
#include "infer/refine/solution.h"

namespace volalign::refine_internal {

/// What a frame's own measurements lose by the joint solution.
struct Disagreement {
  /// Half the square, in standard deviations, of the way from the joint solution to the one that
  /// its own measurements and the priors make most probable. Bulges of sides may be others here.
  double cost = 0;
  /// m, of its observations of faces at the joint solution, and at its own.
  double rms_together = 0, rms_alone = 0;
  Matrix6d covariance = Matrix6d::Zero();  ///< of its pose, by its own measurements
};
/// Of one that takes part in the solution, by a linear approximation; all zero of one without
/// faces, or where it cannot be computed. What is not in `asked_for` is as it is in the solution.
Disagreement MeasureDisagreement(const JointProblem& problem, const Solution& solution,
                                 const FreeSet& asked_for, std::size_t frame);

/// How much less probable, as half a square in standard deviations, what two frames of one still
/// saw of the boxes and of their size is if these are the same for both than if each had its own,
/// by the same approximation. 0 where it cannot be computed.
double MeasureContradiction(const JointProblem& problem, const Solution& solution,
                            const FreeSet& asked_for, std::size_t a, std::size_t b);

/// What Disagreement::cost exceeds by chance in one of a thousand: half a chi-square with as many
/// degrees of freedom as a sensor has unknowns in common with the others (approximated as Wilson
/// and Hilferty have it, "The Distribution of Chi-Square", 1931).
double UnlikelyCost(std::size_t unknowns);

/// Is it more than the noise of both would make? `unknowns`: how many the sensors have in common.
/// Where they have none, nothing disagrees.
bool Disagrees(const Disagreement& disagreement, std::size_t unknowns);

/// What a frame that was set aside would have had to accept.
struct SetAside {
  Pose together;                 ///< its pose in the joint solution with it
  std::vector<int> contradicts;  ///< the frames that show it, the clearest first
  State alone;                   ///< what its own measurements and the priors make most probable
};
struct Agreed {
  Solution solution;                        ///< of the frames that agree
  std::vector<std::optional<SetAside>> of;  ///< of each frame; nothing where it agrees
  /// Of each frame, in the last solution that it took part in.
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
