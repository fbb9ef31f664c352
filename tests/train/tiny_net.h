#pragma once

#include "core/nn/network.h"

namespace volalign {

inline StructureNet TinyNet(Normalization normalization = Normalization::kNone) {
  StructureNetOptions options;
  options.base_channels = 1;
  options.num_classes = 3;
  options.residual_blocks = 1;
  options.normalization = normalization;
  return StructureNet(options);
}

}  // namespace volalign
