#include "core/base/noise_fields.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace volalign {
namespace {

struct SplineTap {
  int first = 0;
  std::array<float, 4> weight{};
};

/// Taps of a uniform cubic B-spline, scaled so that independent unit-variance nodes give unit
/// variance.
std::vector<SplineTap> SplineTaps(int size, double cell, double phase) {
  std::vector<SplineTap> taps(static_cast<std::size_t>(size));
  for (int i = 0; i < size; ++i) {
    const double x = i / cell + phase;
    const double t = x - std::floor(x);
    const std::array<double, 4> w{(1 - t) * (1 - t) * (1 - t) / 6,
                                  (3 * t * t * t - 6 * t * t + 4) / 6,
                                  (-3 * t * t * t + 3 * t * t + 3 * t + 1) / 6, t * t * t / 6};
    const double norm = std::sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2] + w[3] * w[3]);
    SplineTap& tap = taps[static_cast<std::size_t>(i)];
    tap.first = static_cast<int>(std::floor(x));
    for (std::size_t k = 0; k < 4; ++k) tap.weight[k] = static_cast<float>(w[k] / norm);
  }
  return taps;
}

}  // namespace

Image<float> SmoothField(int width, int height, double correlation_px, RandomStream& random) {
  // The kernel's variance is 1/3 cell^2, so the autocorrelation is close to exp(-3/4 x^2): 1/e
  // at 1.155 cells.
  const double cell = std::max(correlation_px / 1.155, 1.0);
  const std::vector<SplineTap> columns = SplineTaps(width, cell, random.Uniform());
  const std::vector<SplineTap> rows = SplineTaps(height, cell, random.Uniform());
  const int grid_width = columns.back().first + 4, grid_height = rows.back().first + 4;
  const PixelRandom noise(random);
  Image<float> grid(grid_width, grid_height);
  for (std::size_t i = 0; i < grid.size(); ++i) grid[i] = noise.Normal(i);

  // Along the few rows of nodes first, so that what is left for each pixel runs along contiguous
  // rows.
  Image<float> lines(width, grid_height);
  for (int j = 0; j < grid_height; ++j) {
    float* line = &lines(0, j);
    for (int u = 0; u < width; ++u) {
      const SplineTap& tap = columns[static_cast<std::size_t>(u)];
      const float* in = &grid(tap.first, j);
      line[u] = tap.weight[0] * in[0] + tap.weight[1] * in[1] + tap.weight[2] * in[2] +
                tap.weight[3] * in[3];
    }
  }
  Image<float> field(width, height);
  for (int v = 0; v < height; ++v) {
    const SplineTap& row = rows[static_cast<std::size_t>(v)];
    const float* in0 = &lines(0, row.first);
    const float* in1 = &lines(0, row.first + 1);
    const float* in2 = &lines(0, row.first + 2);
    const float* in3 = &lines(0, row.first + 3);
    float* out = &field(0, v);
    for (int u = 0; u < width; ++u) {
      out[u] = row.weight[0] * in0[u] + row.weight[1] * in1[u] + row.weight[2] * in2[u] +
               row.weight[3] * in3[u];
    }
  }
  return field;
}

void SmoothUnitNoise(double sigma_u, double sigma_v, Image<float>* noise) {
  const auto side_weight = [](double sigma) {
    return sigma > 0.1 ? static_cast<float>(std::exp(-0.5 / (sigma * sigma))) : 0.0F;
  };
  const float row_side = side_weight(sigma_u), column_side = side_weight(sigma_v);
  const float row_norm = 1 / std::sqrt(1 + 2 * row_side * row_side);
  const float column_norm = 1 / std::sqrt(1 + 2 * column_side * column_side);
  const int width = noise->width(), height = noise->height();
  Image<float> rows(width, height);
  for (int v = 0; v < height; ++v) {
    const float* in = &(*noise)(0, v);
    float* out = &rows(0, v);
    for (int u = 0; u < width; ++u) {
      const float left = in[std::max(u - 1, 0)], right = in[std::min(u + 1, width - 1)];
      out[u] = row_norm * (in[u] + row_side * (left + right));
    }
  }
  for (int v = 0; v < height; ++v) {
    const float* above = &rows(0, std::max(v - 1, 0));
    const float* here = &rows(0, v);
    const float* below = &rows(0, std::min(v + 1, height - 1));
    float* out = &(*noise)(0, v);
    for (int u = 0; u < width; ++u) {
      out[u] = column_norm * (here[u] + column_side * (above[u] + below[u]));
    }
  }
}

int DrawPoisson(double mean, RandomStream& random) {
  const double limit = std::exp(-mean);
  int count = 0;
  for (double product = random.Uniform(); product > limit; product *= random.Uniform()) ++count;
  return count;
}

void ClearDisc(double u, double v, double r, Image<std::uint8_t>* keep) {
  const int v0 = std::max(0, static_cast<int>(std::ceil(v - r)));
  const int v1 = std::min(keep->height() - 1, static_cast<int>(std::floor(v + r)));
  for (int y = v0; y <= v1; ++y) {
    const double half = std::sqrt(std::max(r * r - (y - v) * (y - v), 0.0));
    const int u0 = std::max(0, static_cast<int>(std::ceil(u - half)));
    const int u1 = std::min(keep->width() - 1, static_cast<int>(std::floor(u + half)));
    for (int x = u0; x <= u1; ++x) (*keep)(x, y) = 0;
  }
}

void ClearEllipse(double u, double v, double a, double b, double angle, Image<std::uint8_t>* keep) {
  const double c = std::cos(angle), s = std::sin(angle);
  const double reach = std::max(a, b);
  const int u0 = std::max(0, static_cast<int>(std::ceil(u - reach)));
  const int u1 = std::min(keep->width() - 1, static_cast<int>(std::floor(u + reach)));
  const int v0 = std::max(0, static_cast<int>(std::ceil(v - reach)));
  const int v1 = std::min(keep->height() - 1, static_cast<int>(std::floor(v + reach)));
  for (int y = v0; y <= v1; ++y) {
    for (int x = u0; x <= u1; ++x) {
      const double p = (c * (x - u) + s * (y - v)) / a, q = (c * (y - v) - s * (x - u)) / b;
      if (p * p + q * q <= 1) (*keep)(x, y) = 0;
    }
  }
}

}  // namespace volalign
