#pragma once

#include <ATen/core/Tensor.h>
#include <c10/core/ScalarType.h>

#include "core/network.h"

namespace volalign {

/// StructureNetImpl::forward in training on a CPU, channels-last: the same function within
/// rounding, with the passes over memory between two convolutions joined (normalized_map.h),
/// decoder inputs concatenated where they are computed, and the convolutions after a twofold
/// enlargement computed on the small map.
at::Tensor TrainingForward(const StructureNetLayers& layers, Normalization normalization,
                           at::ScalarType type, const at::Tensor& input);

}  // namespace volalign
