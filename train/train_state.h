#pragma once

#include <string>

#include "core/geometry/structure.h"
#include "core/nn/network.h"
#include "train/compute.h"
#include "train/distributed/flat_module.h"
#include "train/optimizer.h"
#include "train/train_config.h"

namespace volalign {

/// The part of a run that a step changes and a state contains: the network in training, its
/// optimiser and the average of its weights.
class TrainState {
 public:
  /// A new network for the structure's classes, drawn with config.run.seed.
  TrainState(const TrainConfig& config, int num_classes, const Compute& compute);
  TrainState(const TrainState&) = delete;
  TrainState& operator=(const TrainState&) = delete;

  /// Clips, steps the optimiser and the average, and zeroes the gradient. If `finite`, a bool
  /// scalar, is false, nothing else changes. Such a step is not counted on the CPU. On other
  /// devices it is Step.
  void Update(double lr, const at::Tensor& gradient_norm, const at::Tensor& finite);
  /// The same without reading `finite` on the host, which would have to wait for the device. The
  /// device undoes the step, piece by piece, and the step is counted. Undefined: it is true.
  void Step(double lr, const at::Tensor& gradient_norm, const at::Tensor& finite = {});

  StructureNet net;
  FlatModule flat;  ///< the parameters of `net`
  Optimizer optimizer;
  WeightAverage average;
};

/// Copies the weights of the checkpoint `path` (run.init) and returns the number of its training
/// samples. Throws ConfigError if its network differs, DataError if its labels differ.
std::int64_t StartFrom(const std::string& path, const Structure& structure, TrainState* state);

}  // namespace volalign
