#pragma once

namespace volalign {

/// How a share varies from view to view: a Beta distribution.
struct ShareModel {
  double for_it, against;  ///< its parameters, > 0; their proportion is the mean share's

  /// Natural logarithm of the probability of these numbers of independent cells for and against
  /// it, one after the other (a beta-binomial distribution). Counts are >= 0 and need not be whole.
  double LogProbability(double cells_for, double cells_against) const;
};

/// The share at a right pose, and at a wrong one that is the best of its surroundings.
struct ShareOdds {
  ShareModel right, wrong;

  /// Natural logarithm of the odds of right to wrong, both equally probable before. The odds of one
  /// pose to another are the difference.
  double LogOdds(double cells_for, double cells_against) const {
    return right.LogProbability(cells_for, cells_against) -
           wrong.LogProbability(cells_for, cells_against);
  }
};

}  // namespace volalign
