#include "core/base/random.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <string>
#include <vector>

namespace volalign::random_test {
namespace {

using Words = std::array<std::uint32_t, 4>;

// kat_vectors of the Random123 distribution, philox4x32 10.
TEST(Philox, KnownAnswers) {
  EXPECT_EQ(Philox4x32({0, 0, 0, 0}, {0, 0}),
            (Words{0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8}));
  EXPECT_EQ(Philox4x32({0xffffffff, 0xffffffff, 0xffffffff, 0xffffffff}, {0xffffffff, 0xffffffff}),
            (Words{0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd}));
  EXPECT_EQ(Philox4x32({0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344}, {0xa4093822, 0x299f31d0}),
            (Words{0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1}));
}

std::vector<std::uint32_t> Draw(std::uint64_t seed, std::uint64_t index, const std::string& stage,
                                int n) {
  RandomStream stream(seed, index, stage);
  std::vector<std::uint32_t> words;
  words.reserve(static_cast<std::size_t>(n));
  for (int i = 0; i < n; ++i) words.push_back(stream.NextU32());
  return words;
}

// From a Python implementation of Philox and FNV-1a: the stream that trained checkpoints' samples
// come from must never change.
TEST(RandomStream, KnownAnswer) {
  RandomStream stream(0x123456789abcdef0, 0xfedcba9876543210, "pose");
  for (const std::uint32_t word :
       {0xfedb78b4u, 0x0e3a64cbu, 0xe9531ceeu, 0x0f92f28cu, 0xdef34249u, 0xa8ff933fu}) {
    EXPECT_EQ(stream.NextU32(), word);
  }
}

TEST(RandomStream, DependsOnSeedIndexAndStageAlone) {
  const auto once = Draw(7, 12345, "pose", 100);
  Draw(7, 12345, "noise", 17);
  EXPECT_EQ(once, Draw(7, 12345, "pose", 100));
}

// 32-bit words of unrelated streams: among 64 000, about 0.5 pairs coincide by chance; a shared
// block would give runs of equal words.
TEST(RandomStream, StreamsThatDifferInOneBitShareNoPairOfWords) {
  std::set<std::pair<std::uint32_t, std::uint32_t>> seen;
  std::size_t drawn = 0;
  std::vector<std::vector<std::uint32_t>> streams;
  for (int bit = 0; bit < 64; ++bit) {
    streams.push_back(Draw(std::uint64_t{1} << bit, 5, "pose", 256));
    streams.push_back(Draw(5, std::uint64_t{1} << bit, "pose", 256));
  }
  for (const char* stage : {"", "p", "pose", "posf", "noise", "noise/holes"}) {
    streams.push_back(Draw(5, 5, stage, 256));
  }
  for (const auto& words : streams) {
    for (std::size_t i = 0; i + 1 < words.size(); ++i, ++drawn) {
      seen.insert({words[i], words[i + 1]});
    }
  }
  EXPECT_EQ(seen.size(), drawn);
}

// Pearson's coefficient of independent uniforms has a standard deviation of 1 / sqrt(n).
TEST(RandomStream, NeighbouringIndicesAndStagesAreUncorrelated) {
  constexpr int kDraws = 40000;
  const auto correlate = [](RandomStream a, RandomStream b) {
    double sum = 0;
    for (int i = 0; i < kDraws; ++i) sum += (a.Uniform() - 0.5) * (b.Uniform() - 0.5) * 12;
    return sum / kDraws;
  };
  const double limit = 4.5 / std::sqrt(kDraws);
  EXPECT_LT(std::abs(correlate({1, 100, "pose"}, {1, 101, "pose"})), limit);
  EXPECT_LT(std::abs(correlate({1, 100, "pose"}, {1, 100, "room"})), limit);
  EXPECT_LT(std::abs(correlate({1, 100, "pose"}, {2, 100, "pose"})), limit);
  // The first draws over consecutive indices, as a training run sees them.
  double sum = 0;
  for (std::uint64_t i = 0; i < kDraws; ++i) {
    sum += (RandomStream(1, i, "pose").Uniform() - 0.5) *
           (RandomStream(1, i + 1, "pose").Uniform() - 0.5) * 12;
  }
  EXPECT_LT(std::abs(sum / kDraws), limit);
}

TEST(RandomStream, UniformHasTheMomentsOfTheUniformLaw) {
  constexpr int kDraws = 200000;
  RandomStream stream(3, 0, "uniform");
  double moments[5] = {};
  double low = 1, high = 0;
  for (int i = 0; i < kDraws; ++i) {
    const double x = stream.Uniform();
    low = std::min(low, x);
    high = std::max(high, x);
    ASSERT_EQ(x, static_cast<double>(static_cast<float>(x)));
    for (int k = 1; k < 5; ++k) moments[k] += std::pow(x, k) / kDraws;
  }
  EXPECT_GE(low, 0);
  EXPECT_LT(low, 1e-4);
  EXPECT_LT(high, 1);
  EXPECT_GT(high, 1 - 1e-4);
  // E x^k = 1 / (k + 1), variance of x^k = 1 / (2k + 1) - 1 / (k + 1)^2.
  for (int k = 1; k < 5; ++k) {
    const double sigma = std::sqrt((1.0 / (2 * k + 1) - 1.0 / ((k + 1) * (k + 1))) / kDraws);
    EXPECT_NEAR(moments[k], 1.0 / (k + 1), 4.5 * sigma) << k;
  }
}

TEST(RandomStream, UniformOfAnIntervalStaysInIt) {
  RandomStream stream(3, 1, "interval");
  double sum = 0;
  for (int i = 0; i < 20000; ++i) {
    const double x = stream.Uniform(-15, 75);
    ASSERT_GE(x, -15);
    ASSERT_LT(x, 75);
    sum += x;
  }
  EXPECT_NEAR(sum / 20000, 30, 4.5 * 90 / std::sqrt(12.0 * 20000));
}

TEST(RandomStream, BelowIsUniformOverTheIntegers) {
  RandomStream stream(3, 2, "below");
  constexpr int kDraws = 70000;
  std::vector<int> counts(7);
  for (int i = 0; i < kDraws; ++i) {
    const int x = stream.Below(7);
    ASSERT_GE(x, 0);
    ASSERT_LT(x, 7);
    ++counts[static_cast<std::size_t>(x)];
  }
  double chi2 = 0;
  for (const int n : counts) chi2 += (n - kDraws / 7.0) * (n - kDraws / 7.0) / (kDraws / 7.0);
  EXPECT_LT(chi2, 27.9);  // 1e-4 quantile of 6 degrees of freedom
  for (int i = 0; i < 100; ++i) EXPECT_EQ(stream.Below(1), 0);
}

TEST(RandomStream, ChanceHasItsProbability) {
  RandomStream stream(3, 3, "chance");
  int hits = 0;
  for (int i = 0; i < 40000; ++i) hits += stream.Chance(0.3) ? 1 : 0;
  EXPECT_NEAR(hits / 40000.0, 0.3, 4.5 * std::sqrt(0.21 / 40000));
  for (int i = 0; i < 1000; ++i) {
    EXPECT_FALSE(stream.Chance(0));
    EXPECT_TRUE(stream.Chance(1));
  }
}

// Moments of N(0, 1): E x^k = 0, 1, 0, 3, 0, 15; the variance of x^k is E x^2k - (E x^k)^2.
TEST(RandomStream, NormalHasTheMomentsOfTheNormalLaw) {
  constexpr int kDraws = 200000;
  RandomStream stream(3, 4, "normal");
  double moments[5] = {};
  double neighbours = 0, last = stream.Normal();
  std::vector<double> values;
  for (int i = 0; i < kDraws; ++i) {
    const double x = stream.Normal();
    ASSERT_TRUE(std::isfinite(x));
    for (int k = 1; k < 5; ++k) moments[k] += std::pow(x, k) / kDraws;
    neighbours += x * last / kDraws;
    last = x;
    values.push_back(x);
  }
  EXPECT_NEAR(moments[1], 0, 4.5 * std::sqrt(1.0 / kDraws));
  EXPECT_NEAR(moments[2], 1, 4.5 * std::sqrt(2.0 / kDraws));
  EXPECT_NEAR(moments[3], 0, 4.5 * std::sqrt(15.0 / kDraws));
  EXPECT_NEAR(moments[4], 3, 4.5 * std::sqrt(96.0 / kDraws));
  EXPECT_NEAR(neighbours, 0, 4.5 / std::sqrt(kDraws));
  // Kolmogorov-Smirnov against the normal distribution function.
  std::sort(values.begin(), values.end());
  double gap = 0;
  for (int i = 0; i < kDraws; ++i) {
    const double cdf = 0.5 * std::erfc(-values[static_cast<std::size_t>(i)] / std::sqrt(2.0));
    gap = std::max(gap, std::abs(cdf - (i + 0.5) / kDraws));
  }
  EXPECT_LT(gap, 2.2 / std::sqrt(kDraws));
}

TEST(RandomStream, NormalTakesMeanAndSigma) {
  RandomStream a(9, 9, "x"), b(9, 9, "x");
  for (int i = 0; i < 10; ++i) EXPECT_DOUBLE_EQ(a.Normal(2, 0.5), 2 + 0.5 * b.Normal());
}

}  // namespace
}  // namespace volalign::random_test
