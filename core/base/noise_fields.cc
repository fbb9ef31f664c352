#include "core/base/noise_fields.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace volalign {
namespace {

/// FieldLoops::taps of `count` pixels.
struct SplineTaps {
  SplineTaps(int count, double cell, double phase, const FieldLoops& loops)
      : first(static_cast<std::size_t>(count)), weights(4 * first.size()) {
    loops.taps(count, cell, phase, first.data(), weights.data());
  }
  int Nodes() const { return first.back() + 4; }

  std::vector<std::int32_t> first;
  std::vector<float> weights;
};

}  // namespace

VOLALIGN_DECLARE_KERNELS(FieldLoops)

const KernelSets<FieldLoops>& AllFieldLoops() {
  static const KernelSets<FieldLoops> all = CollectKernels(baseline::Get, avx2::Get, avx512::Get);
  return all;
}

const FieldLoops& BestFieldLoops() { return AllFieldLoops().Best(); }

Image<float> SmoothField(int width, int height, double correlation_px, RandomStream& random,
                         const FieldLoops& loops) {
  // The kernel's variance is 1/3 cell^2, so the autocorrelation is close to exp(-3/4 x^2): 1/e
  // at 1.155 cells.
  const double cell = std::max(correlation_px / 1.155, 1.0);
  const SplineTaps columns(width, cell, random.Uniform(), loops);
  const SplineTaps rows(height, cell, random.Uniform(), loops);
  const PixelRandom noise(random);
  Image<float> grid(columns.Nodes(), rows.Nodes());
  loops.normal(noise.key(), 0, static_cast<int>(grid.size()), grid.data());

  // Along the few rows of nodes first, so that the work for each pixel is along contiguous rows.
  Image<float> lines(width, grid.height());
  for (int j = 0; j < grid.height(); ++j)
    loops.along(&grid(0, j), columns.first.data(), columns.weights.data(), width, &lines(0, j));
  Image<float> field(width, height);
  for (int v = 0; v < height; ++v) {
    std::array<const float*, 4> in;
    std::array<float, 4> weights;
    for (std::size_t k = 0; k < 4; ++k) {
      const auto row = static_cast<std::size_t>(v);
      in[k] = &lines(0, rows.first[row] + static_cast<int>(k));
      weights[k] = rows.weights[k * rows.first.size() + row];
    }
    loops.across(in.data(), weights.data(), width, &field(0, v));
  }
  return field;
}

void SmoothUnitNoise(double sigma_u, double sigma_v, Image<float>* noise, const FieldLoops& loops) {
  const auto side_weight = [](double sigma) {
    return sigma > 0.1 ? static_cast<float>(std::exp(-0.5 / (sigma * sigma))) : 0.0F;
  };
  const auto norm_of = [](float side) { return 1 / std::sqrt(1 + 2 * side * side); };
  const float row_side = side_weight(sigma_u), column_side = side_weight(sigma_v);
  const int width = noise->width(), height = noise->height();
  Image<float> rows(width, height);
  for (int v = 0; v < height; ++v)
    loops.smooth(&(*noise)(0, v), row_side, norm_of(row_side), width, &rows(0, v));
  for (int v = 0; v < height; ++v) {
    loops.smooth_across(&rows(0, std::max(v - 1, 0)), &rows(0, v),
                        &rows(0, std::min(v + 1, height - 1)), column_side, norm_of(column_side),
                        width, &(*noise)(0, v));
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
