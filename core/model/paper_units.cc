#include "core/model/paper_units.h"

#include <fmt/format.h>

#include "core/base/error.h"

namespace volalign {
namespace {

struct EncoderUnit {
  int kernel, factor;  // output channels are factor * c
};
const std::vector<std::vector<EncoderUnit>>& Encoder() {
  static const std::vector<std::vector<EncoderUnit>> groups = {{{7, 1}, {5, 2}},
                                                               {{3, 4}, {3, 4}, {3, 4}},
                                                               {{3, 8}, {3, 8}, {3, 8}},
                                                               {{3, 16}, {3, 16}, {3, 16}},
                                                               {{3, 16}, {3, 16}, {3, 16}}};
  return groups;
}

}  // namespace

std::vector<PaperUnit> PaperUnits(const StructureNetOptions& options) {
  const int c = options.base_channels;
  std::vector<PaperUnit> units;
  const auto add = [&](const std::string& name, int in, int out, int kernel) {
    units.push_back({name, in, out, kernel, options.normalization});
  };
  int channels = EncodedChannels(options.input);
  std::vector<int> skip_channels;
  for (std::size_t g = 0; g < Encoder().size(); ++g) {
    for (std::size_t i = 0; i < Encoder()[g].size(); ++i) {
      const EncoderUnit& unit = Encoder()[g][i];
      add(fmt::format("encoder{}_{}", g + 1, i + 1), channels, unit.factor * c, unit.kernel);
      channels = unit.factor * c;
    }
    skip_channels.push_back(channels);
  }
  for (int i = 1; i <= options.residual_blocks; ++i) {
    add(fmt::format("residual{}_1", i), channels, channels, 3);
    add(fmt::format("residual{}_2", i), channels, channels, 3);
  }
  if (options.attention) units.push_back({"attention", channels, 1, 1, Normalization::kNone});
  for (int level = 4; level >= 1; --level) {
    const int skip = skip_channels[static_cast<std::size_t>(level - 1)];
    add(fmt::format("decoder{}_1", level), channels, channels, 3);
    add(fmt::format("decoder{}_2", level), channels, channels, 3);
    add(fmt::format("decoder{}_3", level), channels, skip, 3);
    add(fmt::format("merge{}", level), 2 * skip, skip, 1);
    channels = skip;
  }
  add("decoder0_1", channels, c, 3);
  units.push_back({"classifier", c, options.num_classes, 1, Normalization::kNone});
  return units;
}

const std::vector<int>& EncoderGroups() {
  static const std::vector<int> counts = [] {
    std::vector<int> sizes;
    for (const std::vector<EncoderUnit>& group : Encoder())
      sizes.push_back(static_cast<int>(group.size()));
    return sizes;
  }();
  return counts;
}

std::vector<const char*> VectorsOf(Normalization normalization) {
  switch (normalization) {
    case Normalization::kNone:
      return {"bias"};
    case Normalization::kBatch:
      return {"norm_weight", "norm_bias", "running_mean", "running_var"};
    case Normalization::kGroup:
      return {"norm_weight", "norm_bias"};
  }
  throw Error("invalid Normalization");
}

TensorShapes PaperNetShapes(const StructureNetOptions& options) {
  options.Validate();
  TensorShapes shapes;
  for (const PaperUnit& unit : PaperUnits(options)) {
    shapes[unit.name + ".weight"] = {unit.out, unit.in, unit.kernel, unit.kernel};
    for (const char* name : VectorsOf(unit.normalization))
      shapes[fmt::format("{}.{}", unit.name, name)] = {unit.out};
  }
  return shapes;
}

}  // namespace volalign
