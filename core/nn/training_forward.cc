#include "core/nn/training_forward.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/relu.h>
#include <ATen/ops/sigmoid.h>
#include <ATen/ops/upsample_nearest2d.h>

#include <cstddef>
#include <vector>

#include "core/nn/cpu/convolution.h"
#include "core/nn/cpu/log_probabilities.h"
#include "core/nn/cpu/normalized_map.h"
#include "core/nn/cpu/phase_weight.h"
#include "core/nn/cpu/winograd.h"

namespace volalign {
namespace {

/// Units of the network in one type.
class Units {
 public:
  Units(Normalization normalization, at::ScalarType type)
      : normalization_(normalization), type_(type) {}

  at::Tensor Raw(const ConvUnit& unit, const at::Tensor& x) const { return Raw(unit->weight, x); }

  MapParameters Parameters(const ConvUnit& unit) const {
    if (normalization_ == Normalization::kNone) return {{}, unit->bias, {}, {}};
    return {unit->norm_weight, unit->norm_bias, unit->running_mean, unit->running_var};
  }

  MapRecipe Recipe() const { return {normalization_, /*relu=*/true, /*phases=*/false, type_}; }

  at::Tensor Relu(const ConvUnit& unit, const at::Tensor& x, const at::Tensor& mask = {}) const {
    return NormalizedMap(Raw(unit, x), Parameters(unit), Recipe(), mask);
  }

  at::Tensor WithoutRelu(const ConvUnit& unit, const at::Tensor& x) const {
    MapRecipe recipe = Recipe();
    recipe.relu = false;
    return NormalizedMap(Raw(unit, x), Parameters(unit), recipe);
  }

  /// The unit's result, enlarged to the size of `skip`, and skip.
  at::Tensor EnlargedAndSkip(const ConvUnit& unit, const at::Tensor& x,
                             const at::Tensor& skip) const {
    MapRecipe recipe = Recipe();
    if (skip.size(2) == 2 * x.size(2) && skip.size(3) == 2 * x.size(3)) {
      recipe.phases = true;
      return NormalizedMapAndSkip(Raw(PhaseWeight(unit->weight), x), Parameters(unit), recipe,
                                  skip);
    }
    const at::Tensor large = at::upsample_nearest2d(x, {skip.size(2), skip.size(3)});
    return NormalizedMapAndSkip(Raw(unit, large), Parameters(unit), recipe, skip);
  }

 private:
  at::Tensor Raw(const at::Tensor& weight, const at::Tensor& x) const {
    if (WinogradSuits(x, weight, type_)) return WinogradConvolve(x, weight, type_);
    return Convolve(x, weight, type_, weight.size(2) / 2);
  }

  Normalization normalization_;
  at::ScalarType type_;
};

/// The encoder's maps before each pool, and the last one.
struct Encoded {
  std::vector<at::Tensor> skips;
  at::Tensor x;
};

Encoded Encode(const PaperNetLayers& layers, const Units& units, const at::Tensor& input) {
  Encoded result;
  // The depth itself never becomes bfloat16.
  const ConvUnit& first = layers.encoder[0][0];
  const at::Tensor raw = Convolve(input, first->weight, at::kFloat, first->weight.size(2) / 2);
  at::Tensor x = NormalizedMap(raw, units.Parameters(first), units.Recipe());
  for (std::size_t g = 0; g < layers.encoder.size(); ++g) {
    const std::vector<ConvUnit>& group = layers.encoder[g];
    const bool pool = g + 1 < layers.encoder.size();
    for (std::size_t i = g == 0 ? 1 : 0; i < group.size(); ++i) {
      if (pool && i + 1 == group.size()) {
        const PooledMap map = NormalizedAndPooledMap(units.Raw(group[i], x),
                                                     units.Parameters(group[i]), units.Recipe());
        result.skips.push_back(map.map);
        x = map.pooled;
      } else {
        x = units.Relu(group[i], x);
      }
    }
  }
  result.x = x;
  return result;
}

}  // namespace

at::Tensor TrainingForward(const PaperNetLayers& layers, Normalization normalization,
                           at::ScalarType type, const at::Tensor& input) {
  const Units units(normalization, type);
  Encoded encoded = Encode(layers, units, input);
  at::Tensor x = encoded.x;
  for (const PaperNetLayers::ResidualBlock& block : layers.bottleneck) {
    x = x + units.WithoutRelu(block.second, units.Relu(block.first, at::relu(x)));
  }
  at::Tensor mask;  // [B,1,H/16,W/16]
  if (!layers.attention.is_empty()) {
    mask = AttentionMask(*layers.attention, x);
    x = x * mask.to(type);
  }
  for (const PaperNetLayers::DecoderLevel& level : layers.decoder) {
    x = units.Relu(level.second, units.Relu(level.first, x));
    x = units.EnlargedAndSkip(level.up, x, encoded.skips.back());
    encoded.skips.pop_back();
    x = units.Relu(level.merge, x, mask);
  }
  x = units.Relu(layers.last, x);
  const ConvUnit& classifier = layers.classifier;
  return LogProbabilities(Convolve(x, classifier->weight, type, 0, classifier->bias));
}

}  // namespace volalign
