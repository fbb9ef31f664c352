#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "core/model/network_options.h"

namespace volalign {

/// A convolution of the paper's network ("same" padding, odd kernel, stride 1) with its
/// normalisation. `name` is that of its tensors: encoder1_1, residual2_1, attention, decoder4_3,
/// merge4, classifier.
struct PaperUnit {
  std::string name;
  int in, out, kernel;
  Normalization normalization;
};

/// All units, in the order in which their weights are drawn.
std::vector<PaperUnit> PaperUnits(const StructureNetOptions& options);

/// Number of units in each group of the encoder. A pool lies between two groups.
const std::vector<int>& EncoderGroups();

/// A unit's parameters and buffers beside `weight`: vectors of `out` elements.
std::vector<const char*> VectorsOf(Normalization normalization);

using TensorShapes = std::map<std::string, std::vector<std::int64_t>>;

/// The shapes of the network's parameters and buffers, by their names (`encoder1_1.weight`). Throws
/// ConfigError for invalid options.
TensorShapes PaperNetShapes(const StructureNetOptions& options);

}  // namespace volalign
