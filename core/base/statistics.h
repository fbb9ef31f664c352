#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace volalign {

/// Factor from the median absolute deviation of a normal distribution to its standard deviation.
inline constexpr double kMadToSigma = 1.4826;

/// The element of the rank nearest to q * (n - 1), 0 <= q <= 1, in the order of values. So it is
/// one of the values. If two ranks are equally near, it is the upper one: Quantile(values, 0.5) is
/// the upper median. 0 if there are no values. O(n).
template <class T>
T Quantile(std::vector<T> values, double q) {
  if (values.empty()) return T();
  const auto at = values.begin() + std::lround(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

}  // namespace volalign
