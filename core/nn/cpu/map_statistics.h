#pragma once

#include <ATen/core/Tensor.h>

#include <cstdint>
#include <vector>

#include "core/nn/cpu/map_pass.h"
#include "core/nn/cpu/normalized_map.h"

namespace volalign {

/// Two sums for each sample and channel.
struct MapSums {
  std::int64_t channels;
  std::vector<double> values;  // [S,parts,2,C], after Join [S,2,C]

  MapSums(std::int64_t samples, std::int64_t count)
      : channels(count), values(static_cast<std::size_t>(samples * kMapParts * 2 * count)) {}
  double* Part(std::int64_t sample, std::int64_t part) {
    return values.data() + (sample * kMapParts + part) * 2 * channels;
  }
  void Join(std::int64_t samples) {
    for (std::int64_t s = 0; s < samples; ++s) {
      for (std::int64_t part = 1; part < kMapParts; ++part) {
        for (std::int64_t c = 0; c < 2 * channels; ++c) Part(s, 0)[c] += Part(s, part)[c];
      }
    }
  }
  double First(std::int64_t sample, std::int64_t c) { return Part(sample, 0)[c]; }
  double Second(std::int64_t sample, std::int64_t c) { return Part(sample, 0)[channels + c]; }
};

/// Computes the statistics that `normalization` needs of the pass's raw map, and the affine map
/// from them. Updates the running statistics. Throws Error if batch normalisation has a single
/// value of a channel.
MapAffine NormalizeMap(const MapPass& pass, const MapParameters& parameters,
                       Normalization normalization);

/// The gradient of raw is of_g g + of_raw raw + constant, where g is the gradient of the normalised
/// map; each [S,C].
struct GradientTerms {
  at::Tensor of_g, of_raw, constant;
  at::Tensor scale,
      bias;  ///< gradients of the parameters, [C]; scale undefined without normalisation
};

/// `sums`: over pixels of g (first) and of g (raw - mean) (second).
GradientTerms MapGradientTerms(MapSums& sums, const MapPass& pass, const at::Tensor& scale,
                               Normalization normalization);

}  // namespace volalign
