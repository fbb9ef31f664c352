#pragma once

#include <ATen/core/Tensor.h>
#include <c10/core/ScalarType.h>

#include "core/nn/paper_net.h"

namespace volalign {

/// PaperNetImpl::forward in training on a CPU, channels-last: the same function within
/// rounding, with the passes over memory between two convolutions joined (normalized_map.h),
/// decoder inputs concatenated where they are computed, and the convolutions after a twofold
/// enlargement computed on the small map.
at::Tensor TrainingForward(const PaperNetLayers& layers, Normalization normalization,
                           at::ScalarType type, const at::Tensor& input);

}  // namespace volalign
