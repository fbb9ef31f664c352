#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace volalign {

/// Factor from the median absolute deviation of a normal distribution to its standard deviation.
inline constexpr double kMadToSigma = 1.4826;

/// The element of the rank nearest to q * (n - 1), 0 <= q <= 1, when values are sorted, so that no
/// value is invented; of two as near the upper one: Quantile(values, 0.5) is the upper median. 0 of
/// nothing. O(n).
template <class T>
T Quantile(std::vector<T> values, double q) {
  if (values.empty()) return T();
  const auto at = values.begin() + std::lround(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

}  // namespace volalign
