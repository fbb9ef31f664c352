#pragma once

#include <cstdint>
#include <numeric>

namespace volalign {

/// Normalisation of a convolution's output: none, over the batch, or over groups of channels of
/// each sample.
enum class Normalization { kNone, kBatch, kGroup };

/// Added to the variance in both normalisations.
inline constexpr double kNormEpsilon = 1e-5;
/// Share of a batch in the running statistics.
inline constexpr double kNormMomentum = 0.1;

/// Number of groups over `channels`.
inline std::int64_t NormGroups(std::int64_t channels) {
  constexpr std::int64_t kMost = 8;
  return std::gcd(channels, kMost);
}

}  // namespace volalign
