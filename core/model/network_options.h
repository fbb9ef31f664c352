#pragma once

#include <cstdint>
#include <numeric>
#include <string>

#include "core/config/config_word.h"

namespace volalign {

// Limits of a network's options. So neither a recipe nor a file's metadata can ask for any amount
// of memory. The paper's network has 32 channels and 4 blocks.
inline constexpr int kMostBaseChannels = 1024;
inline constexpr int kMostResidualBlocks = 64;
inline constexpr int kMostClasses = 256;  ///< labels are uint8

/// Normalisation of a convolution's output: none, over the batch, or over groups of channels of
/// each sample.
enum class Normalization { kNone, kBatch, kGroup };

/// Added to the variance in both normalisations.
inline constexpr double kNormEpsilon = 1e-5;
/// Share of a batch in the running statistics.
inline constexpr double kNormMomentum = 0.1;

/// Number of groups over `channels`.
inline std::int64_t NormGroups(std::int64_t channels) {
  constexpr std::int64_t kMost = 8;
  return std::gcd(channels, kMost);
}

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
  int base_channels = 32;      ///< c, 1 to kMostBaseChannels
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
