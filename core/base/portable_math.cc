#include "core/base/portable_math.h"

#include <fmt/format.h>

#include <cmath>

#include "core/base/error.h"

namespace volalign {
namespace {

// pi/2 in three parts; the first two have 33 significant bits, so that their products with a
// quadrant number below 2^20 are exact (Cody and Waite).
constexpr double kHalfPi1 = 0x1.921fb544p+0;
constexpr double kHalfPi2 = 0x1.0b4611a6p-34;
constexpr double kHalfPi3 = 0x1.3198a2e037073p-69;
constexpr double kTwoOverPi = 0.63661977236758134308;

/// 1 - x^2/(a (a+1)) (1 - x^2/((a+2) (a+3)) (1 - ...)), `terms` factors: cosine with a = 1, sine /
/// x with a = 2. The remainder is below 1e-18 for |x| <= pi/4 and 9 terms.
double Series(double x_squared, int a) {
  constexpr int kTerms = 9;
  double sum = 1;
  for (int k = kTerms - 1; k >= 1; --k) {
    const int n = a + 2 * k;
    sum = 1 - x_squared / (n * (n + 1)) * sum;
  }
  return x_squared / (a * (a + 1)) * sum;
}

}  // namespace

SinCos PortableSinCos(double angle) {
  if (!(std::abs(angle) <= 1e5)) {
    throw Error(fmt::format("PortableSinCos: angle {} violates |angle| <= 1e5 rad", angle));
  }
  const double quadrant = std::nearbyint(angle * kTwoOverPi);
  const double x = ((angle - quadrant * kHalfPi1) - quadrant * kHalfPi2) - quadrant * kHalfPi3;
  const double sine = x - x * Series(x * x, 2);
  const double cosine = 1 - Series(x * x, 1);
  switch (static_cast<int>(quadrant) & 3) {
    case 0:
      return {sine, cosine};
    case 1:
      return {cosine, -sine};
    case 2:
      return {-sine, -cosine};
    default:
      return {-cosine, sine};
  }
}

double PortableCbrt(double x) {
  if (!(x >= 0 && std::isfinite(x))) {
    throw Error(fmt::format("PortableCbrt: {} violates 0 <= x < infinity", x));
  }
  if (x == 0) return 0;
  int exponent = 0;
  double m = std::frexp(x, &exponent);  // [0.5, 1)
  while (exponent % 3 != 0) {
    m *= 0.5;
    ++exponent;
  }
  double y = 0.5 + 0.5 * m;
  for (int i = 0; i < 4; ++i) {  // Halley's iteration: the error is cubed each time
    const double cube = y * y * y;
    y *= (cube + 2 * m) / (2 * cube + m);
  }
  return std::ldexp(y, exponent / 3);
}

}  // namespace volalign
