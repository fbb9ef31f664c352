#pragma once

#include <ATen/core/Tensor.h>
#include <c10/core/ScalarType.h>

#include "core/model/normalization.h"

namespace volalign {

/// The operations after a convolution in training on a CPU: normalisation with the batch's
/// statistics, ReLU, and the following ones. Each direction is one pass over memory instead of one
/// per operation. Everything is in channels-last order. The result equals that of the single
/// operations within rounding: sums are float64, and nothing is rounded to bfloat16 between
/// normalisation, ReLU and mask.
struct MapRecipe {
  Normalization normalization = Normalization::kNone;
  bool relu = true;
  /// The map is twice as large as the convolution's output, which has the four phases of its pixels
  /// (core/nn/cpu/phase_weight.h).
  bool phases = false;
  at::ScalarType type = at::kFloat;  ///< of the result: kFloat or kBFloat16
};

/// The parameters of a ConvUnit except its weight.
struct MapParameters {
  at::Tensor scale;                      ///< [C], undefined without normalisation
  at::Tensor bias;                       ///< [C]
  at::Tensor running_mean, running_var;  ///< [C], updated by kBatch, else undefined
};

/// z [B,C,H,W] from a convolution's output without bias: raw [B,C,H,W], or [B,4C,H/2+1,W/2+1] with
/// phases. Times the nearest pixel of `mask` [B,1,h,w] if defined.
at::Tensor NormalizedMap(const at::Tensor& raw, const MapParameters& parameters,
                         const MapRecipe& recipe, const at::Tensor& mask = {});

/// z and `skip` [B,C,H,W] of z's type, concatenated: [B,2C,H,W].
at::Tensor NormalizedMapAndSkip(const at::Tensor& raw, const MapParameters& parameters,
                                const MapRecipe& recipe, const at::Tensor& skip);

struct PooledMap {
  at::Tensor map;     ///< [B,C,H,W]
  at::Tensor pooled;  ///< [B,C,H/2,W/2], maximum over 2x2 pixels
};
PooledMap NormalizedAndPooledMap(const at::Tensor& raw, const MapParameters& parameters,
                                 const MapRecipe& recipe);

}  // namespace volalign
