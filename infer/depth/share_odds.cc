#include "infer/depth/share_odds.h"

#include <math.h>  // lgamma_r is POSIX; std::lgamma writes to a variable that all threads share

namespace volalign {

namespace {

double LogGamma(double x) {
  int sign = 0;
  return lgamma_r(x, &sign);
}

double LogBeta(double a, double b) { return LogGamma(a) + LogGamma(b) - LogGamma(a + b); }

}  // namespace

double ShareModel::LogProbability(double cells_for, double cells_against) const {
  return LogBeta(for_it + cells_for, against + cells_against) - LogBeta(for_it, against);
}

}  // namespace volalign
