#pragma once

#include <ATen/core/Tensor.h>

#include <functional>
#include <string>

#include "core/base/image.h"

namespace volalign {

/// A validation sample with the network's output for it.
struct MetricInput {
  const DepthImage& depth;      ///< m, 0 without depth
  const LabelImage& labels;     ///< the true ones
  const LabelImage& predicted;  ///< the most probable ones
  const at::Tensor& log_probs;  ///< [K,H,W] float32, on the network's device
};

/// A number that says how good an output is. NaN: the sample has none.
using Metric = std::function<double(const MetricInput&)>;

/// Measures `name` in every validation, beside miou and miou_authors (core/geometry/metrics.h);
/// logs have its mean over the samples that have one. To be called at the start of a program,
/// before other threads run. Throws Error if the name exists.
void RegisterMetric(const std::string& name, Metric metric);

}  // namespace volalign
