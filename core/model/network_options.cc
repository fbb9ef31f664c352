#include "core/model/network_options.h"

#include <fmt/format.h>

#include <cmath>

#include "core/base/error.h"

namespace volalign {

int EncodedChannels(InputEncoding input) { return input == InputEncoding::kDepth ? 1 : 2; }

void StructureNetOptions::Validate() const {
  const auto require = [](const char* name, int value, int low, int high) {
    if (value < low || value > high) {
      throw ConfigError(
          fmt::format("model.{0} = {1} violates {0} in [{2}, {3}]", name, value, low, high));
    }
  };
  require("base_channels", base_channels, 1, kMostBaseChannels);
  require("num_classes", num_classes, 2, kMostClasses);
  require("residual_blocks", residual_blocks, 0, kMostResidualBlocks);
  if (!std::isfinite(background_bias)) {
    throw ConfigError(
        fmt::format("model.background_bias = {} is not a finite number", background_bias));
  }
}

bool operator==(const StructureNetOptions& a, const StructureNetOptions& b) {
  return a.kind == b.kind && a.base_channels == b.base_channels && a.num_classes == b.num_classes &&
         a.attention == b.attention && a.normalization == b.normalization && a.input == b.input &&
         a.residual_blocks == b.residual_blocks && a.background_bias == b.background_bias;
}

}  // namespace volalign
