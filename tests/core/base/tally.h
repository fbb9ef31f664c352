#pragma once

#include <cmath>

namespace volalign {

/// Moments of numbers that are added one by one.
struct Tally {
  double count = 0, sum = 0, squares = 0;

  Tally& operator+=(double x) {
    ++count;
    sum += x;
    squares += x * x;
    return *this;
  }
  double Mean() const { return sum / count; }
  double Rms() const { return std::sqrt(squares / count); }
  /// About the mean, of these very numbers.
  double Variance() const { return squares / count - Mean() * Mean(); }
};

}  // namespace volalign
