#pragma once

#include <cstdint>
#include <vector>

#include "core/base/image.h"
#include "core/base/random.h"
#include "core/base/vector_clones.h"

namespace volalign {

/// Cheap random numbers for pixels: a counter hashed by SplitMix64 (Steele et al., OOPSLA 2014),
/// keyed by two draws of a RandomStream. Bit-equal on any number of threads.
class PixelRandom {
 public:
  explicit PixelRandom(RandomStream& random)
      : key_(static_cast<std::uint64_t>(random.NextU32()) << 32 | random.NextU32()) {}

  VOLALIGN_INLINE std::uint64_t Bits(std::uint64_t i) const {
    std::uint64_t x = key_ + (i + 1) * 0x9E3779B97F4A7C15ULL;
    x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ULL;
    x = (x ^ (x >> 27)) * 0x94D049BB133111EBULL;
    return x ^ (x >> 31);
  }
  /// In [0, 1).
  VOLALIGN_INLINE float Uniform(std::uint64_t i) const {
    return static_cast<float>(static_cast<std::int32_t>(Bits(i) >> 40)) * 0x1.0p-24F;
  }
  /// Zero mean, unit variance, |x| < 3.5: the sum of four uniform 16-bit numbers.
  VOLALIGN_INLINE float Normal(std::uint64_t i) const {
    const std::uint64_t bits = Bits(i);
    const auto low = static_cast<std::uint32_t>(bits),
               high = static_cast<std::uint32_t>(bits >> 32);
    const std::uint32_t sum = (low & 0xFFFF) + (low >> 16) + (high & 0xFFFF) + (high >> 16);
    return (static_cast<float>(static_cast<std::int32_t>(sum)) - 131070.0F) *
           (1.0F / 37837.23F);  // sqrt(4 (2^32 - 1) / 12)
  }
  /// The numbers of `count` pixels from `first` on.
  void Uniforms(std::uint64_t first, int count, float* out) const;
  void Normals(std::uint64_t first, int count, float* out) const;

 private:
  std::uint64_t key_;
};

/// A smooth normal field, zero mean and unit variance at every pixel: white noise on a grid,
/// interpolated with cubic B-splines. Its autocorrelation falls to 1/e at about `correlation_px`.
Image<float> SmoothField(int width, int height, double correlation_px, RandomStream& random);

/// Smooths white noise by a three-tap Gaussian of `sigma_u`, `sigma_v` px along rows and columns,
/// and scales it back to its variance.
void SmoothUnitNoise(double sigma_u, double sigma_v, Image<float>* noise);

/// Calls visit(u, v, p, q, pair) for each pixel (u, v) and its neighbour (p, q), first the right
/// one, then the lower one. `pair` is the pair's own number, for PixelRandom.
template <class Visit>
void ForEachNeighbourPair(int width, int height, const Visit& visit) {
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      const std::uint64_t pair =
          2 * (static_cast<std::uint64_t>(v) * static_cast<std::uint64_t>(width) +
               static_cast<std::uint64_t>(u));
      if (u + 1 < width) visit(u, v, u + 1, v, pair);
      if (v + 1 < height) visit(u, v, u, v + 1, pair + 1);
    }
  }
}

/// Number of events of a Poisson process (Knuth), mean below 100.
int DrawPoisson(double mean, RandomStream& random);

/// Sets the pixels within r px of (u, v) to zero.
void ClearDisc(double u, double v, double r, Image<std::uint8_t>* keep);

/// Sets the pixels of an ellipse with half axes a, b (px), turned by `angle` rad, to zero.
void ClearEllipse(double u, double v, double a, double b, double angle, Image<std::uint8_t>* keep);

}  // namespace volalign
