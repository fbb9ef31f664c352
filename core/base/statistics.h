#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace volalign {

/// Factor from the median absolute deviation of a normal distribution to its standard deviation.
inline constexpr double kMadToSigma = 1.4826;

/// The element of a rank, 0 <= rank < n, when values are sorted. O(n).
template <class T>
T RankedElement(std::vector<T> values, std::size_t rank) {
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(rank);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

/// The element of rank floor(q * (n - 1)), 0 <= q <= 1, so that no value is invented:
/// Quantile(values, 0.5) is the lower median. 0 of nothing. O(n).
template <class T>
T Quantile(std::vector<T> values, double q) {
  if (values.empty()) return T();
  const auto rank = static_cast<std::size_t>(q * static_cast<double>(values.size() - 1));
  return RankedElement(std::move(values), rank);
}

/// The element of the rank nearest to q * (n - 1), 0 <= q <= 1; 0 of nothing. O(n).
template <class T>
T NearestQuantile(std::vector<T> values, double q) {
  if (values.empty()) return T();
  const auto rank =
      static_cast<std::size_t>(std::lround(q * static_cast<double>(values.size() - 1)));
  return RankedElement(std::move(values), rank);
}

/// The upper median: the element of rank n / 2. 0 of nothing. O(n).
template <class T>
T Median(std::vector<T> values) {
  if (values.empty()) return T();
  const std::size_t rank = values.size() / 2;
  return RankedElement(std::move(values), rank);
}

}  // namespace volalign
