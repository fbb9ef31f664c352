#include "core/base/noise_fields.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace volalign {
namespace {

/// Taps of a uniform cubic B-spline with nodes `cell` px apart, scaled so that independent
/// unit-variance nodes give unit variance. Pixel i uses the nodes from first[i] on, with the
/// weights [4,count].
VOLALIGN_CLONES void Taps(int count, double cell, double phase, std::int32_t* __restrict first,
                          float* __restrict weights) {
  float* __restrict w0 = weights, * __restrict w1 = weights + count;
  float* __restrict w2 = weights + 2 * count, * __restrict w3 = weights + 3 * count;
  for (int i = 0; i < count; ++i) {
    const double x = i / cell + phase;
    const double whole = __builtin_floor(x), t = x - whole;
    const double a = (1 - t) * (1 - t) * (1 - t) / 6, b = (3 * t * t * t - 6 * t * t + 4) / 6;
    const double c = (-3 * t * t * t + 3 * t * t + 3 * t + 1) / 6, d = t * t * t / 6;
    const double norm = __builtin_sqrt(a * a + b * b + c * c + d * d);
    first[i] = static_cast<std::int32_t>(whole);
    w0[i] = static_cast<float>(a / norm);
    w1[i] = static_cast<float>(b / norm);
    w2[i] = static_cast<float>(c / norm);
    w3[i] = static_cast<float>(d / norm);
  }
}

struct SplineTaps {
  SplineTaps(int count, double cell, double phase)
      : first(static_cast<std::size_t>(count)), weights(4 * first.size()) {
    Taps(count, cell, phase, first.data(), weights.data());
  }
  int Nodes() const { return first.back() + 4; }

  std::vector<std::int32_t> first;
  std::vector<float> weights;
};

/// A row of pixels from a row of nodes.
VOLALIGN_CLONES void Along(const float* __restrict nodes, const std::int32_t* __restrict first,
                           const float* __restrict weights, int count, float* __restrict out) {
  for (int i = 0; i < count; ++i) {
    const std::int32_t at = first[i];
    out[i] = weights[i] * nodes[at] + weights[count + i] * nodes[at + 1] +
             weights[2 * count + i] * nodes[at + 2] + weights[3 * count + i] * nodes[at + 3];
  }
}

/// The weighted sum of four rows.
VOLALIGN_CLONES void Across(const float* const* rows, const float* weights, int count,
                            float* __restrict out) {
  const float* __restrict in0 = rows[0], * __restrict in1 = rows[1];
  const float* __restrict in2 = rows[2], * __restrict in3 = rows[3];
  const float w0 = weights[0], w1 = weights[1], w2 = weights[2], w3 = weights[3];
  for (int i = 0; i < count; ++i) out[i] = w0 * in0[i] + w1 * in1[i] + w2 * in2[i] + w3 * in3[i];
}

/// norm (in[i] + side (in[i - 1] + in[i + 1])). At the ends, the missing neighbour is the end
/// itself.
VOLALIGN_CLONES void Smooth(const float* __restrict in, float side, float norm, int count,
                            float* __restrict out) {
  const int last = count - 1;
  for (int i = 1; i < last; ++i) out[i] = norm * (in[i] + side * (in[i - 1] + in[i + 1]));
  out[0] = norm * (in[0] + side * (in[0] + in[last > 0 ? 1 : 0]));
  out[last] = norm * (in[last] + side * (in[last > 0 ? last - 1 : 0] + in[last]));
}

VOLALIGN_CLONES void SmoothAcross(const float* above, const float* here, const float* below,
                                  float side, float norm, int count, float* __restrict out) {
  for (int i = 0; i < count; ++i) out[i] = norm * (here[i] + side * (above[i] + below[i]));
}

}  // namespace

VOLALIGN_CLONES void PixelRandom::Uniforms(std::uint64_t first, int count, float* out) const {
  for (int i = 0; i < count; ++i) out[i] = Uniform(first + static_cast<std::uint64_t>(i));
}

VOLALIGN_CLONES void PixelRandom::Normals(std::uint64_t first, int count, float* out) const {
  for (int i = 0; i < count; ++i) out[i] = Normal(first + static_cast<std::uint64_t>(i));
}

Image<float> SmoothField(int width, int height, double correlation_px, RandomStream& random) {
  // The kernel's variance is 1/3 cell^2, so the autocorrelation is close to exp(-3/4 x^2): 1/e
  // at 1.155 cells.
  const double cell = std::max(correlation_px / 1.155, 1.0);
  const SplineTaps columns(width, cell, random.Uniform());
  const SplineTaps rows(height, cell, random.Uniform());
  const PixelRandom noise(random);
  Image<float> grid(columns.Nodes(), rows.Nodes());
  noise.Normals(0, static_cast<int>(grid.size()), grid.data());

  // Along the few rows of nodes first, so that the work for each pixel is along contiguous rows.
  Image<float> lines(width, grid.height());
  for (int j = 0; j < grid.height(); ++j)
    Along(&grid(0, j), columns.first.data(), columns.weights.data(), width, &lines(0, j));
  Image<float> field(width, height);
  for (int v = 0; v < height; ++v) {
    std::array<const float*, 4> in;
    std::array<float, 4> weights;
    for (std::size_t k = 0; k < 4; ++k) {
      const auto row = static_cast<std::size_t>(v);
      in[k] = &lines(0, rows.first[row] + static_cast<int>(k));
      weights[k] = rows.weights[k * rows.first.size() + row];
    }
    Across(in.data(), weights.data(), width, &field(0, v));
  }
  return field;
}

void SmoothUnitNoise(double sigma_u, double sigma_v, Image<float>* noise) {
  const auto side_weight = [](double sigma) {
    return sigma > 0.1 ? static_cast<float>(std::exp(-0.5 / (sigma * sigma))) : 0.0F;
  };
  const auto norm_of = [](float side) { return 1 / std::sqrt(1 + 2 * side * side); };
  const float row_side = side_weight(sigma_u), column_side = side_weight(sigma_v);
  const int width = noise->width(), height = noise->height();
  Image<float> rows(width, height);
  for (int v = 0; v < height; ++v)
    Smooth(&(*noise)(0, v), row_side, norm_of(row_side), width, &rows(0, v));
  for (int v = 0; v < height; ++v) {
    SmoothAcross(&rows(0, std::max(v - 1, 0)), &rows(0, v), &rows(0, std::min(v + 1, height - 1)),
                 column_side, norm_of(column_side), width, &(*noise)(0, v));
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
