#pragma once

#include <array>
#include <cstddef>
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
  bool relu;  ///< negative values of the result become 0
};

/// The other operations, of one value or two. kEnlarge repeats pixels of the first to the size of
/// the second, a result of kSizeOf.
enum class PaperOp { kRelu, kPool, kSigmoid, kAdd, kMultiply, kConcatenate, kSizeOf, kEnlarge };

/// The paper's segmentation network (section "Semantic Correspondences"): encoder of 14
/// convolutions and 4 max-pools, pre-activated residual bottleneck, soft attention, and decoder
/// with skips and 14 convolutions. `x` is the encoded depth; gives the logits. `maker` does what
/// the operations mean for its Value: computes with tensors, or writes nodes of ONNX or lines of a
/// script. Operations have the names of their results.
template <class Maker>
typename Maker::Value MakePaperNet(const StructureNetOptions& options, Maker& maker,
                                   typename Maker::Value x) {
  using Value = typename Maker::Value;
  constexpr std::array<int, 5> kFactors = {2, 4, 8, 16, 16};  // of c, after a group of the encoder
  const int c = options.base_channels;
  int channels = EncodedChannels(options.input);
  const auto unit = [&](const std::string& name, int out, int kernel, bool relu = true) {
    const int in = channels;
    channels = out;
    return PaperUnit{name, in, out, kernel, options.normalization, relu};
  };
  x = maker.Unit(unit("encoder1_1", c, 7), x);
  x = maker.Unit(unit("encoder1_2", kFactors[0] * c, 5), x);
  std::vector<Value> skips;
  for (std::size_t g = 1; g < kFactors.size(); ++g) {
    const std::string group = std::to_string(g + 1);
    skips.push_back(x);
    x = maker.Op(PaperOp::kPool, "pool" + group, x);
    for (const char* i : {"_1", "_2", "_3"})
      x = maker.Unit(unit("encoder" + group + i, kFactors[g] * c, 3), x);
  }
  for (int i = 1; i <= options.residual_blocks; ++i) {
    const std::string name = "residual" + std::to_string(i);
    Value y = maker.Op(PaperOp::kRelu, name + ".relu", x);
    y = maker.Unit(unit(name + "_1", channels, 3), y);
    y = maker.Unit(unit(name + "_2", channels, 3, /*relu=*/false), y);
    x = maker.Op(PaperOp::kAdd, name, x, y);
  }
  Value mask{};
  if (options.attention) {
    mask = maker.Unit({"attention", channels, 1, 1, Normalization::kNone, false}, x);
    mask = maker.Op(PaperOp::kSigmoid, "mask", mask);
    x = maker.Op(PaperOp::kMultiply, "attended", x, mask);
  }
  for (std::size_t g = skips.size(); g-- > 0; skips.pop_back()) {
    const std::string level = std::to_string(g + 1), decoder = "decoder" + level;
    const int of_skip = kFactors[g] * c;
    const Value size = maker.Op(PaperOp::kSizeOf, "size" + level, skips[g]);
    x = maker.Unit(unit(decoder + "_1", channels, 3), x);
    x = maker.Unit(unit(decoder + "_2", channels, 3), x);
    x = maker.UnitOfEnlarged(unit(decoder + "_3", of_skip, 3), "up" + level, x, size);
    x = maker.Op(PaperOp::kConcatenate, "both" + level, x, skips[g]);
    channels += of_skip;
    x = maker.Unit(unit("merge" + level, of_skip, 1), x);
    if (!options.attention) continue;
    const Value enlarged = maker.Op(PaperOp::kEnlarge, "mask" + level, mask, size);
    x = maker.Op(PaperOp::kMultiply, "attended" + level, x, enlarged);
  }
  x = maker.Unit(unit("decoder0_1", c, 3), x);
  return maker.Unit({"classifier", c, options.num_classes, 1, Normalization::kNone, false}, x);
}

/// All units, in the order in which their weights are drawn.
std::vector<PaperUnit> PaperUnits(const StructureNetOptions& options);

using TensorShapes = std::map<std::string, std::vector<std::int64_t>>;

/// The shapes of the network's parameters and buffers, by their names (`encoder1_1.weight`). Throws
/// ConfigError for invalid options.
TensorShapes PaperNetShapes(const StructureNetOptions& options);

}  // namespace volalign
