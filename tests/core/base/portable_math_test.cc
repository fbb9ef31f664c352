#include "core/base/portable_math.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

#include "core/base/error.h"
#include "core/base/random.h"
#include "tests/core/base/expect_error.h"

namespace volalign::portable_math_test {
namespace {

// The C library's long double functions (64 bits of mantissa) are the independent answer.
TEST(PortableMath, SineAndCosineAreExactToOneUnit) {
  RandomStream random(1, 0, "angles");
  for (int i = 0; i < 200'000; ++i) {
    const double range = i % 2 ? 7 : 1e5;
    const double angle = random.Uniform(-range, range) + random.Uniform() * 1e-7;
    const SinCos got = PortableSinCos(angle);
    ASSERT_LE(std::abs(got.sin - std::sin(static_cast<long double>(angle))), 2.3e-16L) << angle;
    ASSERT_LE(std::abs(got.cos - std::cos(static_cast<long double>(angle))), 2.3e-16L) << angle;
  }
  EXPECT_EQ(PortableSinCos(0).sin, 0);
  EXPECT_EQ(PortableSinCos(0).cos, 1);
}

TEST(PortableMath, CubeRootIsExactToAFewUnits) {
  RandomStream random(1, 0, "cubes");
  for (int i = 0; i < 100'000; ++i) {
    const double x = std::ldexp(random.Uniform() + 1e-9, random.Below(40) - 30);
    const long double root = std::cbrt(static_cast<long double>(x));
    ASSERT_LE(std::abs(PortableCbrt(x) - root), 1e-15L * root) << x;
  }
  EXPECT_EQ(PortableCbrt(0), 0);
  EXPECT_EQ(PortableCbrt(1), 1);
}

// A change of this sum changes the bits of every sample's pose. Recorded on x86-64; the same with
// glibc's FMA variants switched off.
TEST(PortableMath, GivesTheRecordedBits) {
  std::uint64_t sum = 0;
  const auto add = [&](double x) {
    std::uint64_t bits = 0;
    std::memcpy(&bits, &x, sizeof bits);
    sum = sum * 6364136223846793005u + bits;
  };
  RandomStream random(1, 0, "bits");
  for (int i = 0; i < 100'000; ++i) {
    const SinCos turn = PortableSinCos(random.Uniform(0, 6.283185307179586));
    add(turn.sin);
    add(turn.cos);
    add(PortableCbrt(random.Uniform()));
  }
  EXPECT_EQ(sum, 16650685270636957622u);
}

TEST(PortableMath, RejectsWhatItCannotDo) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  ExpectError<Error>([&] { PortableSinCos(nan); }, {"|angle| <= 1e5"});
  ExpectError<Error>([] { PortableSinCos(2e5); }, {"200000"});
  ExpectError<Error>([] { PortableCbrt(-1); }, {"-1"});
}

}  // namespace
}  // namespace volalign::portable_math_test
