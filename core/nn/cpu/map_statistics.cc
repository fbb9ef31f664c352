#include "core/nn/cpu/map_statistics.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/empty.h>
#include <ATen/ops/zeros.h>

#include <algorithm>
#include <cmath>

#include "core/base/error.h"

namespace volalign {
namespace {

/// Number, mean and sum of squared deviations of a set of values, which can be joined with another
/// (Chan, Golub and LeVeque 1979).
struct Moments {
  double count = 0, mean = 0, squares = 0;
  void Add(double n, double other_mean, double other_squares) {
    const double delta = other_mean - mean, total = count + n;
    squares += other_squares + delta * delta * count * n / total;
    mean += delta * n / total;
    count = total;
  }
};

/// Channels of all samples (kBatch) or of one (kGroup) that share their statistics.
struct Share {
  std::int64_t sample_begin, sample_end, channel_begin, channel_end;
};

std::vector<Share> Shares(Normalization normalization, const MapSize& size) {
  std::vector<Share> shares;
  if (normalization == Normalization::kBatch) {
    for (std::int64_t c = 0; c < size.channels; ++c) shares.push_back({0, size.samples, c, c + 1});
  }
  if (normalization == Normalization::kGroup) {
    const std::int64_t groups = NormGroups(size.channels), wide = size.channels / groups;
    for (std::int64_t s = 0; s < size.samples; ++s) {
      for (std::int64_t g = 0; g < groups; ++g)
        shares.push_back({s, s + 1, g * wide, (g + 1) * wide});
    }
  }
  return shares;
}

void MoveRunning(const MapParameters& parameters, std::int64_t c, const Moments& m) {
  float* mean = parameters.running_mean.data_ptr<float>() + c;
  float* var = parameters.running_var.data_ptr<float>() + c;
  *mean = static_cast<float>((1 - kNormMomentum) * *mean + kNormMomentum * m.mean);
  *var = static_cast<float>((1 - kNormMomentum) * *var + kNormMomentum * m.squares / (m.count - 1));
}

/// MapSums of raw and its square about the first pixel of each sample, `shift` [S,C].
MapSums RawSums(const MapPass& pass, const at::Tensor& shift) {
  MapSums sums(pass.size.samples, pass.size.channels);
  ForMapParts(pass.size.samples, pass.size.height,
              [&](std::int64_t s, std::int64_t part, std::int64_t begin, std::int64_t end) {
                simd::Kernels().moments(pass.Rows(s), begin, end,
                                        shift.data_ptr<float>() + s * pass.size.channels,
                                        sums.Part(s, part));
              });
  sums.Join(pass.size.samples);
  return sums;
}

}  // namespace

MapAffine NormalizeMap(const MapPass& pass, const MapParameters& parameters,
                       Normalization normalization) {
  const MapSize& size = pass.size;
  const std::int64_t n = size.channels;
  MapAffine result;
  for (at::Tensor* x : {&result.a, &result.b, &result.mean, &result.inverse})
    *x = at::zeros({size.samples, n}, at::kFloat);
  float *a = result.a.data_ptr<float>(), *b = result.b.data_ptr<float>();
  const float* bias = parameters.bias.data_ptr<float>();
  if (normalization == Normalization::kNone) {
    result.a.fill_(1);
    for (std::int64_t s = 0; s < size.samples; ++s) std::copy(bias, bias + n, b + s * n);
    return result;
  }
  const at::Tensor first =
      pass.raw.select(3, 0).select(2, 0).narrow(1, 0, n).to(at::kFloat).contiguous();  // [S,C]
  MapSums sums = RawSums(pass, first);
  const float *shift = first.data_ptr<float>(), *scale = parameters.scale.data_ptr<float>();
  const double pixels = static_cast<double>(size.height * size.width);
  for (const Share& share : Shares(normalization, size)) {
    Moments m;
    for (std::int64_t s = share.sample_begin; s < share.sample_end; ++s) {
      for (std::int64_t c = share.channel_begin; c < share.channel_end; ++c) {
        const double sum = sums.First(s, c);
        m.Add(pixels, shift[s * n + c] + sum / pixels, sums.Second(s, c) - sum * sum / pixels);
      }
    }
    if (normalization == Normalization::kBatch && m.count < 2)
      throw Error("batch normalisation needs more than one pixel in a batch");
    const double inverse = 1 / std::sqrt(m.squares / m.count + kNormEpsilon);
    for (std::int64_t s = share.sample_begin; s < share.sample_end; ++s) {
      for (std::int64_t c = share.channel_begin; c < share.channel_end; ++c) {
        a[s * n + c] = static_cast<float>(scale[c] * inverse);
        b[s * n + c] = static_cast<float>(bias[c] - scale[c] * inverse * m.mean);
        result.mean.data_ptr<float>()[s * n + c] = static_cast<float>(m.mean);
        result.inverse.data_ptr<float>()[s * n + c] = static_cast<float>(inverse);
      }
    }
    if (normalization == Normalization::kBatch) MoveRunning(parameters, share.channel_begin, m);
  }
  return result;
}

GradientTerms MapGradientTerms(MapSums& sums, const MapPass& pass, const at::Tensor& scale,
                               Normalization normalization) {
  const MapSize& size = pass.size;
  const std::int64_t n = size.channels;
  GradientTerms result;
  for (at::Tensor* x : {&result.of_g, &result.of_raw, &result.constant})
    *x = at::zeros({size.samples, n}, at::kFloat);
  std::vector<double> of_scale(static_cast<std::size_t>(n)), of_bias(static_cast<std::size_t>(n));
  const float *mean = pass.affine.mean.data_ptr<float>(),
              *inverse = pass.affine.inverse.data_ptr<float>();
  for (std::int64_t s = 0; s < size.samples; ++s) {
    for (std::int64_t c = 0; c < n; ++c) {
      of_bias[static_cast<std::size_t>(c)] += sums.First(s, c);
      of_scale[static_cast<std::size_t>(c)] += sums.Second(s, c) * inverse[s * n + c];
    }
  }
  if (normalization == Normalization::kNone) result.of_g.fill_(1);
  const double pixels = static_cast<double>(size.height * size.width);
  for (const Share& share : Shares(normalization, size)) {
    double first = 0, second = 0, count = 0;
    for (std::int64_t s = share.sample_begin; s < share.sample_end; ++s) {
      for (std::int64_t c = share.channel_begin; c < share.channel_end; ++c) {
        const double w = scale.data_ptr<float>()[c];
        first += w * sums.First(s, c);
        second += w * sums.Second(s, c);
        count += pixels;
      }
    }
    for (std::int64_t s = share.sample_begin; s < share.sample_end; ++s) {
      for (std::int64_t c = share.channel_begin; c < share.channel_end; ++c) {
        const std::int64_t i = s * n + c;
        const double r = inverse[i], slope = -r * r * r * second / count;
        result.of_g.data_ptr<float>()[i] = static_cast<float>(scale.data_ptr<float>()[c] * r);
        result.of_raw.data_ptr<float>()[i] = static_cast<float>(slope);
        result.constant.data_ptr<float>()[i] =
            static_cast<float>(-r * first / count - slope * mean[i]);
      }
    }
  }
  const auto tensor = [n](const std::vector<double>& values) {
    at::Tensor x = at::empty({n}, at::kFloat);
    std::transform(values.begin(), values.end(), x.data_ptr<float>(),
                   [](double v) { return static_cast<float>(v); });
    return x;
  };
  result.bias = tensor(of_bias);
  if (normalization != Normalization::kNone) result.scale = tensor(of_scale);
  return result;
}

}  // namespace volalign
