#pragma once

#include <ATen/core/Tensor.h>
#include <c10/core/ScalarType.h>

#include "core/nn/paper_net.h"

namespace volalign {

/// PaperNetImpl::forward in training on a CPU, channels-last: the same function within rounding.
/// Passes over memory between two convolutions are joined (normalized_map.h). Decoder inputs are
/// concatenated where they are computed. Convolutions after a twofold enlargement are computed on
/// the small map.
at::Tensor TrainingForward(const PaperNetLayers& layers, Normalization normalization,
                           at::ScalarType type, const at::Tensor& input);

}  // namespace volalign
