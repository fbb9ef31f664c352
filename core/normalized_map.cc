#include "core/normalized_map.h"

#include <ATen/Parallel.h>
#include <ATen/TensorOperators.h>
#include <ATen/ops/empty.h>
#include <ATen/ops/empty_like.h>
#include <ATen/ops/zeros.h>
#include <torch/csrc/autograd/custom_function.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>
#include <vector>

#include "core/error.h"
#include "core/simd/map_kernels.h"

namespace volalign {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

constexpr double kRunningMomentum = 0.1;
/// Into so many parts of rows a sample is cut, whatever the number of threads: sums do not depend
/// on it.
constexpr std::int64_t kParts = 4;

std::int64_t PartBegin(std::int64_t rows, std::int64_t part) {
  return part == kParts ? rows : rows * part / kParts / 2 * 2;
}

/// Calls f(sample, part, first row, end) in parallel.
template <class F>
void ForParts(std::int64_t samples, std::int64_t rows, const F& f) {
  at::parallel_for(0, samples * kParts, 1, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t i = begin; i < end; ++i) {
      f(i / kParts, i % kParts, PartBegin(rows, i % kParts), PartBegin(rows, i % kParts + 1));
    }
  });
}

bool IsBf16(const at::Tensor& x) { return x.scalar_type() == at::kBFloat16; }

struct Size {
  std::int64_t samples, channels, height, width;
};

Size MapSize(const at::Tensor& raw, bool phases) {
  if (!phases) return {raw.size(0), raw.size(1), raw.size(2), raw.size(3)};
  return {raw.size(0), raw.size(1) / 4, 2 * (raw.size(2) - 1), 2 * (raw.size(3) - 1)};
}

/// z = act(a raw + b), with a [S,C], b [S,C] and the mean [S,C] and deviation's inverse [S,C] that
/// they follow from.
struct Affine {
  at::Tensor a, b, mean, inverse;
};

std::int32_t Nearest(std::int64_t i, std::int64_t from, std::int64_t to) {
  const float scale = static_cast<float>(from) / static_cast<float>(to);
  return static_cast<std::int32_t>(std::min<std::int64_t>(
      static_cast<std::int64_t>(std::floor(static_cast<float>(i) * scale)), from - 1));
}

/// Index of the nearest pixel of a mask for each row and column.
struct MaskGrid {
  std::vector<std::int32_t> row, column;
  MaskGrid(const at::Tensor& mask, const Size& size) {
    if (!mask.defined()) return;
    for (std::int64_t i = 0; i < size.height; ++i)
      row.push_back(Nearest(i, mask.size(2), size.height));
    for (std::int64_t i = 0; i < size.width; ++i)
      column.push_back(Nearest(i, mask.size(3), size.width));
  }
};

char* SampleData(const at::Tensor& x, std::int64_t sample) {
  return static_cast<char*>(x.data_ptr()) +
         sample * x.stride(0) * static_cast<std::int64_t>(x.element_size());
}

/// What the kernels see of a forward or backward pass, for any of its samples.
struct Pass {
  at::Tensor raw, raw_gradient, map, mask, pooled, winner;
  Affine affine;
  Size size;
  bool phases = false, relu = true;
  MaskGrid grid;

  simd::MapRows Rows(std::int64_t sample) const {
    simd::MapRows m;
    m.width = size.width;
    m.channels = size.channels;
    m.phases = phases;
    m.relu = relu;
    m.raw = SampleData(raw, sample);
    m.raw_bf16 = IsBf16(raw);
    if (raw_gradient.defined()) m.raw_gradient = SampleData(raw_gradient, sample);
    if (map.defined()) {
      m.map = SampleData(map, sample);
      m.map_stride = map.stride(3);
      m.map_bf16 = IsBf16(map);
    }
    if (affine.a.defined()) {
      m.a = affine.a.data_ptr<float>() + sample * size.channels;
      m.b = affine.b.data_ptr<float>() + sample * size.channels;
    }
    if (mask.defined()) {
      m.mask = mask.data_ptr<float>() + sample * mask.stride(0);
      m.mask_row = grid.row.data();
      m.mask_column = grid.column.data();
      m.mask_width = mask.size(3);
    }
    if (pooled.defined()) {
      m.pooled = SampleData(pooled, sample);
      m.winner = reinterpret_cast<std::uint8_t*>(SampleData(winner, sample));
      m.pooled_height = pooled.size(2);
      m.pooled_width = pooled.size(3);
    }
    return m;
  }
};

/// Two sums for each sample and channel.
struct Sums {
  std::int64_t channels;
  std::vector<double> values;  // [S,parts,2,C], after Join [S,2,C]

  Sums(std::int64_t samples, std::int64_t count)
      : channels(count), values(static_cast<std::size_t>(samples * kParts * 2 * count)) {}
  double* Part(std::int64_t sample, std::int64_t part) {
    return values.data() + (sample * kParts + part) * 2 * channels;
  }
  void Join(std::int64_t samples) {
    for (std::int64_t s = 0; s < samples; ++s) {
      for (std::int64_t part = 1; part < kParts; ++part) {
        for (std::int64_t c = 0; c < 2 * channels; ++c) Part(s, 0)[c] += Part(s, part)[c];
      }
    }
  }
  double First(std::int64_t sample, std::int64_t c) { return Part(sample, 0)[c]; }
  double Second(std::int64_t sample, std::int64_t c) { return Part(sample, 0)[channels + c]; }
};

/// Number, mean and sum of squared deviations of a set of values, to which another's are added
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

std::vector<Share> Shares(Normalization normalization, const Size& size) {
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
  *mean = static_cast<float>((1 - kRunningMomentum) * *mean + kRunningMomentum * m.mean);
  *var = static_cast<float>((1 - kRunningMomentum) * *var +
                            kRunningMomentum * m.squares / (m.count - 1));
}

/// Sums of raw and its square about the first pixel of each sample, `shift` [S,C].
Sums RawSums(const Pass& pass, const at::Tensor& shift) {
  Sums sums(pass.size.samples, pass.size.channels);
  ForParts(pass.size.samples, pass.size.height,
           [&](std::int64_t s, std::int64_t part, std::int64_t begin, std::int64_t end) {
             simd::Kernels().moments(pass.Rows(s), begin, end,
                                     shift.data_ptr<float>() + s * pass.size.channels,
                                     sums.Part(s, part));
           });
  sums.Join(pass.size.samples);
  return sums;
}

Affine Normalize(const Pass& pass, const MapParameters& parameters, Normalization normalization) {
  const Size& size = pass.size;
  const std::int64_t n = size.channels;
  Affine result;
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
  Sums sums = RawSums(pass, first);
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

/// The gradient of raw is of_g g + of_raw raw + constant, g being that of the normalised map; each
/// [S,C].
struct GradientTerms {
  at::Tensor of_g, of_raw, constant;
  at::Tensor scale,
      bias;  ///< gradients of the parameters, [C]; scale undefined without normalisation
};

GradientTerms Coefficients(Sums& sums, const Pass& pass, const at::Tensor& scale,
                           Normalization normalization) {
  const Size& size = pass.size;
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
    const at::Tensor x = at::empty({n}, at::kFloat);
    std::transform(values.begin(), values.end(), x.data_ptr<float>(),
                   [](double v) { return static_cast<float>(v); });
    return x;
  };
  result.bias = tensor(of_bias);
  if (normalization != Normalization::kNone) result.scale = tensor(of_scale);
  return result;
}

at::Tensor EmptyMap(const Size& size, std::int64_t channels, at::ScalarType type) {
  return at::empty({size.samples, channels, size.height, size.width},
                   at::TensorOptions(type).memory_format(at::MemoryFormat::ChannelsLast));
}

/// `x` where its channels are adjacent and its pixels evenly spaced, as the kernels need (`dense`:
/// without gaps); else a copy that is.
at::Tensor Spaced(const at::Tensor& x, bool dense = false) {
  const std::int64_t stride = x.stride(3);
  if (x.stride(1) == 1 && x.stride(2) == x.size(3) * stride &&
      x.stride(0) == x.size(2) * x.stride(2) &&
      (dense ? stride == x.size(1) : stride >= x.size(1))) {
    return x;
  }
  // Through an empty tensor: contiguous(ChannelsLast) may keep strides of dimensions of size 1.
  at::Tensor copy =
      EmptyMap({x.size(0), x.size(1), x.size(2), x.size(3)}, x.size(1), x.scalar_type());
  copy.as_strided_(copy.sizes(),
                   {x.size(1) * x.size(2) * x.size(3), 1, x.size(3) * x.size(1), x.size(1)});
  return copy.copy_(x);
}

/// Sum of a number a pixel [S,H,W] over the pixels of each pixel of the mask [S,1,h,w].
at::Tensor ToMask(const at::Tensor& pixels, const at::Tensor& mask, const MaskGrid& grid) {
  const at::Tensor result = at::zeros(mask.sizes(), at::kFloat);
  const auto in = pixels.accessor<float, 3>();
  auto out = result.accessor<float, 4>();
  for (std::int64_t s = 0; s < pixels.size(0); ++s) {
    for (std::int64_t y = 0; y < pixels.size(1); ++y) {
      auto row = out[s][0][grid.row[static_cast<std::size_t>(y)]];
      for (std::int64_t x = 0; x < pixels.size(2); ++x)
        row[grid.column[static_cast<std::size_t>(x)]] += in[s][y][x];
    }
  }
  return result;
}

/// Zero where no phase of a map has its place.
void ClearBorder(const at::Tensor& raw_gradient) {
  for (int dim : {2, 3}) {
    raw_gradient.select(dim, 0).zero_();
    raw_gradient.select(dim, raw_gradient.size(dim) - 1).zero_();
  }
}

/// An autograd function takes no undefined tensor: an empty one stands for it.
at::Tensor OrEmpty(const at::Tensor& x) { return x.defined() ? x : at::empty({0}, at::kFloat); }
at::Tensor OrUndefined(const at::Tensor& x) { return x.numel() > 0 ? x : at::Tensor(); }

class MapFunction : public torch::autograd::Function<MapFunction> {
 public:
  static variable_list forward(AutogradContext* context, const at::Tensor& raw,
                               const at::Tensor& scale, const at::Tensor& /*bias*/,
                               const at::Tensor& mask_or_empty, const at::Tensor& skip_or_empty,
                               const MapParameters& parameters, const MapRecipe& recipe,
                               bool pool) {
    const at::Tensor mask = OrUndefined(mask_or_empty), skip = OrUndefined(skip_or_empty);
    Pass pass = MakePass(raw, mask, recipe);
    const Size& size = pass.size;
    pass.affine = Normalize(pass, parameters, recipe.normalization);
    pass.map = EmptyMap(size, skip.defined() ? 2 * size.channels : size.channels, recipe.type);
    if (pool) {
      const Size half = {size.samples, size.channels, size.height / 2, size.width / 2};
      pass.pooled = EmptyMap(half, size.channels, recipe.type);
      pass.winner = EmptyMap(half, size.channels, at::kByte);
    }
    const at::Tensor spaced_skip = skip.defined() ? Spaced(skip.to(recipe.type)) : skip;
    ForParts(size.samples, size.height,
             [&](std::int64_t s, std::int64_t, std::int64_t begin, std::int64_t end) {
               const simd::MapRows rows = pass.Rows(s);
               simd::Kernels().apply(rows, begin, end);
               if (pool) simd::Kernels().pool(rows, begin, end);
               if (skip.defined()) CopySkip(spaced_skip, pass, s, begin, end);
             });
    context->save_for_backward({pass.raw, OrUndefined(scale), pass.mask, pass.winner, pass.affine.a,
                                pass.affine.b, pass.affine.mean, pass.affine.inverse});
    context->saved_data["normalization"] = static_cast<std::int64_t>(recipe.normalization);
    context->saved_data["relu"] = recipe.relu;
    context->saved_data["phases"] = recipe.phases;
    context->saved_data["skip"] = skip.defined();
    context->saved_data["mask_type"] =
        static_cast<std::int64_t>(mask.defined() ? mask.scalar_type() : at::kFloat);
    if (pool) return {pass.map, pass.pooled};
    return {pass.map};
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const auto saved = context->get_saved_variables();
    const auto flag = [&](const char* name) { return context->saved_data[name].toBool(); };
    MapRecipe recipe;
    recipe.normalization = static_cast<Normalization>(context->saved_data["normalization"].toInt());
    recipe.relu = flag("relu");
    recipe.phases = flag("phases");
    Pass pass = MakePass(saved[0], saved[2], recipe);
    pass.affine = {saved[4], saved[5], saved[6], saved[7]};
    const Size& size = pass.size;
    pass.map = Spaced(gradients[0]);
    if (gradients.size() > 1) {
      pass.pooled = Spaced(gradients[1], /*dense=*/true);
      pass.winner = saved[3];
    }
    const at::Tensor of_pixel = pass.mask.defined()
                                    ? at::empty({size.samples, size.height, size.width}, at::kFloat)
                                    : at::Tensor();
    Sums sums(size.samples, size.channels);
    const auto of_sample = [&](const at::Tensor& x, std::int64_t s) {
      return x.data_ptr<float>() + s * size.channels;
    };
    ForParts(size.samples, size.height,
             [&](std::int64_t s, std::int64_t part, std::int64_t begin, std::int64_t end) {
               float* pixels = of_pixel.defined()
                                   ? of_pixel.data_ptr<float>() + s * size.height * size.width
                                   : nullptr;
               simd::Kernels().gradient_sums(pass.Rows(s), begin, end,
                                             of_sample(pass.affine.mean, s), sums.Part(s, part),
                                             pixels);
             });
    sums.Join(size.samples);
    const GradientTerms k = Coefficients(sums, pass, saved[1], recipe.normalization);
    pass.raw_gradient = at::empty_like(pass.raw);
    if (recipe.phases) ClearBorder(pass.raw_gradient);
    ForParts(size.samples, size.height,
             [&](std::int64_t s, std::int64_t, std::int64_t begin, std::int64_t end) {
               simd::Kernels().gradient(pass.Rows(s), begin, end, of_sample(k.of_g, s),
                                        of_sample(k.of_raw, s), of_sample(k.constant, s));
             });
    at::Tensor of_mask, of_skip;
    if (pass.mask.defined()) {
      of_mask = ToMask(of_pixel, pass.mask, pass.grid)
                    .to(static_cast<at::ScalarType>(context->saved_data["mask_type"].toInt()));
    }
    if (flag("skip")) of_skip = gradients[0].narrow(1, size.channels, size.channels);
    return {pass.raw_gradient, k.scale, k.bias, of_mask, of_skip, {}, {}, {}};
  }

 private:
  static Pass MakePass(const at::Tensor& raw, const at::Tensor& mask, const MapRecipe& recipe) {
    const Size size = MapSize(raw, recipe.phases);
    const at::Tensor plain = mask.defined() ? mask.to(at::kFloat).contiguous() : at::Tensor();
    Pass pass{
        Spaced(raw, /*dense=*/true), {}, {}, plain, {}, {}, {}, size, recipe.phases, recipe.relu,
        MaskGrid(plain, size)};
    return pass;
  }

  /// Rows of `skip` behind the channels of the map.
  static void CopySkip(const at::Tensor& skip, const Pass& pass, std::int64_t s, std::int64_t begin,
                       std::int64_t end) {
    const std::int64_t bytes = static_cast<std::int64_t>(skip.element_size());
    const std::int64_t n = pass.size.channels * bytes, step = skip.stride(3) * bytes;
    for (std::int64_t i = begin * pass.size.width; i < end * pass.size.width; ++i) {
      std::memcpy(SampleData(pass.map, s) + (2 * i + 1) * n, SampleData(skip, s) + i * step,
                  static_cast<std::size_t>(n));
    }
  }
};

class LogSoftmaxFunction : public torch::autograd::Function<LogSoftmaxFunction> {
 public:
  static at::Tensor forward(AutogradContext* context, const at::Tensor& given) {
    const at::Tensor logits = given.contiguous(at::MemoryFormat::ChannelsLast);
    const std::int64_t classes = logits.size(1), plane = logits.size(2) * logits.size(3);
    const at::Tensor result = at::empty(logits.sizes(), at::kFloat);
    ForParts(logits.size(0), plane,
             [&](std::int64_t s, std::int64_t, std::int64_t begin, std::int64_t end) {
               simd::Kernels().log_softmax(SampleData(logits, s), IsBf16(logits), begin, end,
                                           classes, plane,
                                           result.data_ptr<float>() + s * classes * plane);
             });
    context->save_for_backward({result});
    context->saved_data["type"] = static_cast<std::int64_t>(logits.scalar_type());
    return result;
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const at::Tensor result = context->get_saved_variables()[0],
                     gradient = gradients[0].contiguous();
    const std::int64_t samples = result.size(0), classes = result.size(1),
                       plane = result.size(2) * result.size(3);
    const auto type = static_cast<at::ScalarType>(context->saved_data["type"].toInt());
    const at::Tensor of_logits =
        EmptyMap({samples, classes, result.size(2), result.size(3)}, classes, type);
    ForParts(samples, plane,
             [&](std::int64_t s, std::int64_t, std::int64_t begin, std::int64_t end) {
               const std::int64_t first = s * classes * plane;
               simd::Kernels().log_softmax_gradient(
                   result.data_ptr<float>() + first, gradient.data_ptr<float>() + first, begin, end,
                   classes, plane, SampleData(of_logits, s), type == at::kBFloat16);
             });
    return {of_logits};
  }
};

variable_list Apply(const at::Tensor& raw, const MapParameters& parameters, const MapRecipe& recipe,
                    const at::Tensor& mask, const at::Tensor& skip, bool pool) {
  return MapFunction::apply(raw, OrEmpty(parameters.scale), parameters.bias, OrEmpty(mask),
                            OrEmpty(skip), parameters, recipe, pool);
}

}  // namespace

at::Tensor NormalizedMap(const at::Tensor& raw, const MapParameters& parameters,
                         const MapRecipe& recipe, const at::Tensor& mask) {
  return Apply(raw, parameters, recipe, mask, {}, false)[0];
}

at::Tensor NormalizedMapAndSkip(const at::Tensor& raw, const MapParameters& parameters,
                                const MapRecipe& recipe, const at::Tensor& skip) {
  return Apply(raw, parameters, recipe, {}, skip, false)[0];
}

PooledMap NormalizedAndPooledMap(const at::Tensor& raw, const MapParameters& parameters,
                                 const MapRecipe& recipe) {
  const variable_list result = Apply(raw, parameters, recipe, {}, {}, true);
  return {result[0], result[1]};
}

at::Tensor PhaseWeight(const at::Tensor& weight) {
  const std::int64_t out = weight.size(0), in = weight.size(1);
  // Which of the two taps a tap of the 3x3 kernel falls on, for the first and the second pixel of a
  // pair.
  constexpr int kTap[2][3] = {{0, 1, 1}, {0, 0, 1}};
  const at::Tensor fold = at::zeros({9, 16}, at::kFloat);
  auto entry = fold.accessor<float, 2>();
  for (int i = 0; i < 2; ++i) {
    for (int j = 0; j < 2; ++j) {
      for (int k = 0; k < 9; ++k)
        entry[k][(i * 2 + j) * 4 + kTap[i][k / 3] * 2 + kTap[j][k % 3]] = 1;
    }
  }
  const at::Tensor folded = weight.reshape({out * in, 9}).matmul(fold).view({out, in, 4, 4});
  return folded.permute({2, 0, 1, 3}).reshape({4 * out, in, 2, 2});
}

at::Tensor LogProbabilities(const at::Tensor& logits) { return LogSoftmaxFunction::apply(logits); }

}  // namespace volalign
