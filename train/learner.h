#pragma once

#include <string>

#include "core/geometry/structure.h"
#include "core/nn/network.h"
#include "train/averaging.h"
#include "train/compute.h"
#include "train/distributed/flat_module.h"
#include "train/optimizer.h"
#include "train/train_config.h"

namespace volalign {

/// What a step changes and a state holds: the network in training, its optimiser and the average of
/// its weights.
class Learner {
 public:
  /// A new network for the structure's classes, drawn with config.run.seed.
  Learner(const TrainConfig& config, int num_classes, const Compute& compute);
  Learner(const Learner&) = delete;
  Learner& operator=(const Learner&) = delete;

  /// Clips, steps the optimiser and the average; the gradient is zero afterwards. Where `finite`, a
  /// bool scalar, is false nothing else changes and no step is counted.
  void Update(double lr, const at::Tensor& gradient_norm, const at::Tensor& finite);
  /// The same without a look at `finite`, for which the host would have to wait for the device:
  /// the step is taken back on the device, piece by piece, and it is counted.
  void UpdateUnseen(double lr, const at::Tensor& gradient_norm, const at::Tensor& finite);

  StructureNet net;
  FlatModule flat;  ///< the parameters of `net`
  Optimizer optimizer;
  WeightAverage average;

 private:
  void Step(double lr, const at::Tensor& gradient_norm, const at::Tensor& finite = {});
};

/// Takes over the weights of the checkpoint `path` (run.init) and returns the number of samples
/// that it was trained on. Throws ConfigError when its network is another one, DataError when its
/// labels are.
std::int64_t StartFrom(const std::string& path, const Structure& structure, Learner* learner);

}  // namespace volalign
