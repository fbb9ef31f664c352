#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace volalign {

/// Factor from the median absolute deviation of a normal distribution to its standard deviation.
inline constexpr double kMadToSigma = 1.4826;

/// The element of rank floor(q * (n - 1)), 0 <= q <= 1, so that no value is invented:
/// Quantile(values, 0.5) is the lower median. 0 of nothing. O(n).
template <class T>
T Quantile(std::vector<T> values, double q) {
  if (values.empty()) return T();
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

/// The upper median: the element of rank n / 2. 0 of nothing. O(n).
template <class T>
T Median(std::vector<T> values) {
  if (values.empty()) return T();
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

}  // namespace volalign
