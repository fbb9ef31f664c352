#pragma once

namespace volalign {

/// How a share varies from view to view: a Beta distribution.
struct ShareModel {
  double for_it, against;  ///< its parameters, > 0; their proportion is the mean share's

  /// Natural logarithm of the probability of so many independent cells for it and against it, one
  /// after the other (a beta-binomial distribution), for counts >= 0 that need not be whole.
  double LogProbability(double cells_for, double cells_against) const;
};

/// The share where a pose is right, and where it is wrong but the best of its surroundings.
struct ShareOdds {
  ShareModel right, wrong;

  /// Natural logarithm of the odds of right to wrong, both being equally probable before. Those of
  /// one pose to another are the difference.
  double LogOdds(double cells_for, double cells_against) const {
    return right.LogProbability(cells_for, cells_against) -
           wrong.LogProbability(cells_for, cells_against);
  }
};

}  // namespace volalign
