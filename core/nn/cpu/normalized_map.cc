#include "core/nn/cpu/normalized_map.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/empty.h>
#include <ATen/ops/empty_like.h>
#include <ATen/ops/zeros.h>
#include <torch/csrc/autograd/custom_function.h>

#include <cstring>
#include <utility>

#include "core/nn/cpu/map_pass.h"
#include "core/nn/cpu/map_statistics.h"
#include "core/nn/simd/map_kernels.h"

namespace volalign {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

/// Clears the border, where a map has no phase.
void ClearBorder(const at::Tensor& raw_gradient) {
  for (int dim : {2, 3}) {
    raw_gradient.select(dim, 0).zero_();
    raw_gradient.select(dim, raw_gradient.size(dim) - 1).zero_();
  }
}

/// An autograd function takes no undefined tensor: an empty one replaces it.
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
    MapPass pass = MakePass(raw, mask, recipe);
    const MapSize& size = pass.size;
    pass.affine = NormalizeMap(pass, parameters, recipe.normalization);
    pass.map = EmptyMap(size, skip.defined() ? 2 * size.channels : size.channels, recipe.type);
    if (pool) {
      const MapSize half = {size.samples, size.channels, size.height / 2, size.width / 2};
      pass.pooled = EmptyMap(half, size.channels, recipe.type);
      pass.winner = EmptyMap(half, size.channels, at::kByte);
    }
    const at::Tensor spaced_skip = skip.defined() ? EvenlySpaced(skip.to(recipe.type)) : skip;
    ForMapParts(size.samples, size.height,
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
    MapPass pass = MakePass(saved[0], saved[2], recipe);
    pass.affine = {saved[4], saved[5], saved[6], saved[7]};
    const MapSize& size = pass.size;
    pass.map = EvenlySpaced(gradients[0]);
    if (gradients.size() > 1) {
      pass.pooled = EvenlySpaced(gradients[1], /*dense=*/true);
      pass.winner = saved[3];
    }
    const at::Tensor of_pixel = pass.mask.defined()
                                    ? at::empty({size.samples, size.height, size.width}, at::kFloat)
                                    : at::Tensor();
    MapSums sums(size.samples, size.channels);
    const auto of_sample = [&](const at::Tensor& x, std::int64_t s) {
      return x.data_ptr<float>() + s * size.channels;
    };
    ForMapParts(size.samples, size.height,
                [&](std::int64_t s, std::int64_t part, std::int64_t begin, std::int64_t end) {
                  float* pixels = of_pixel.defined()
                                      ? of_pixel.data_ptr<float>() + s * size.height * size.width
                                      : nullptr;
                  simd::Kernels().gradient_sums(pass.Rows(s), begin, end,
                                                of_sample(pass.affine.mean, s), sums.Part(s, part),
                                                pixels);
                });
    sums.Join(size.samples);
    const GradientTerms k = MapGradientTerms(sums, pass, saved[1], recipe.normalization);
    pass.raw_gradient = at::empty_like(pass.raw);
    if (recipe.phases) ClearBorder(pass.raw_gradient);
    ForMapParts(size.samples, size.height,
                [&](std::int64_t s, std::int64_t, std::int64_t begin, std::int64_t end) {
                  simd::Kernels().gradient(pass.Rows(s), begin, end, of_sample(k.of_g, s),
                                           of_sample(k.of_raw, s), of_sample(k.constant, s));
                });
    at::Tensor of_mask, of_skip;
    if (pass.mask.defined()) {
      of_mask = SumsOverMask(of_pixel, pass.mask, pass.grid)
                    .to(static_cast<at::ScalarType>(context->saved_data["mask_type"].toInt()));
    }
    if (flag("skip")) of_skip = gradients[0].narrow(1, size.channels, size.channels);
    return {pass.raw_gradient, k.scale, k.bias, of_mask, of_skip, {}, {}, {}};
  }

 private:
  static MapPass MakePass(const at::Tensor& raw, const at::Tensor& mask, const MapRecipe& recipe) {
    const MapSize size = SizeOfMap(raw, recipe.phases);
    const at::Tensor plain = mask.defined() ? mask.to(at::kFloat).contiguous() : at::Tensor();
    MapPass pass{EvenlySpaced(raw, /*dense=*/true),
                 {},
                 {},
                 plain,
                 {},
                 {},
                 {},
                 size,
                 recipe.phases,
                 recipe.relu,
                 MaskGrid(plain, size)};
    return pass;
  }

  /// Rows of `skip` behind the channels of the map.
  static void CopySkip(const at::Tensor& skip, const MapPass& pass, std::int64_t s,
                       std::int64_t begin, std::int64_t end) {
    const std::int64_t bytes = static_cast<std::int64_t>(skip.element_size());
    const std::int64_t n = pass.size.channels * bytes, step = skip.stride(3) * bytes;
    for (std::int64_t i = begin * pass.size.width; i < end * pass.size.width; ++i) {
      std::memcpy(SampleData(pass.map, s) + (2 * i + 1) * n, SampleData(skip, s) + i * step,
                  static_cast<std::size_t>(n));
    }
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

}  // namespace volalign
