#pragma once

#include <string>

#include "core/config/config_word.h"
#include "core/model/normalization.h"

namespace volalign {

enum class InputEncoding { kDepth, kDepthMask };

constexpr Words<Normalization, 3> WordsOf(Normalization) {
  return {{{"none", Normalization::kNone},
           {"batch", Normalization::kBatch},
           {"group", Normalization::kGroup}}};
}
constexpr Words<InputEncoding, 2> WordsOf(InputEncoding) {
  return {{{"depth", InputEncoding::kDepth}, {"depth_mask", InputEncoding::kDepthMask}}};
}

/// Channels C of an encoded depth map. The depth z is in m, 0 if missing. `kDepth`: C = 1, z
/// itself, as in the paper. `kDepthMask`: C = 2, (min(z, kDepthClamp) - kDepthCentre) * mask and
/// mask = z > 0.
int EncodedChannels(InputEncoding input);

/// depth_mask: the centre of depths, m, where the structure stands in training.
inline constexpr double kDepthCentre = 2.0;
/// depth_mask: anything farther, m, is background whatever its distance. Clamping keeps isolated
/// far values (Azure Kinect reports up to 16 m) from dominating the batch statistics.
inline constexpr double kDepthClamp = 6.0;

/// The defaults are the network of the paper (section "Semantic Correspondences").
struct StructureNetOptions {
  std::string kind = "paper";  ///< of NetworkKinds() (core/nn/network.h)
  int base_channels = 32;      ///< c, 1 to kMostBaseChannels (core/model/network_limits.h)
  int num_classes = 21;        ///< K, 2 to kMostClasses, background included
  bool attention = true;
  Normalization normalization = Normalization::kNone;
  InputEncoding input = InputEncoding::kDepth;
  int residual_blocks = 4;     ///< 0 to kMostResidualBlocks
  double background_bias = 0;  ///< initial bias of the background class in the classifier

  /// Throws ConfigError that names option, value and constraint.
  void Validate() const;
  friend bool operator==(const StructureNetOptions& a, const StructureNetOptions& b);
};

}  // namespace volalign
