#pragma once

#include <array>
#include <cstdint>
#include <string_view>

namespace volalign {

/// Philox4x32-10 (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011): four
/// 32-bit words of a 128-bit counter and a 64-bit key, no state.
std::array<std::uint32_t, 4> Philox4x32(std::array<std::uint32_t, 4> counter,
                                        std::array<std::uint32_t, 2> key);

/// A stream of random numbers that depends only on (seed, index, stage). So a stage that is
/// switched off does not change the draws of others. Bit-equal on every machine up to the C
/// library's log and cos in Normal().
class RandomStream {
 public:
  RandomStream(std::uint64_t seed, std::uint64_t index, std::string_view stage);

  std::uint32_t NextU32();
  /// In [0, 1), 24 bits of mantissa (float-exact).
  double Uniform();
  double Uniform(double low, double high);
  /// Uniform integer in [0, n), n > 0.
  int Below(int n);
  bool Chance(double probability);
  /// Standard normal (Box-Muller).
  double Normal();
  double Normal(double mean, double sigma);

 private:
  std::array<std::uint32_t, 2> key_;
  std::array<std::uint32_t, 4> counter_;
  std::array<std::uint32_t, 4> block_{};
  int used_ = 4;
  bool has_spare_ = false;
  double spare_ = 0;
};

}  // namespace volalign
