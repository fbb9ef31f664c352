#pragma once

#include <cstdint>

#include "core/nn/network.h"
#include "train/distributed/flat_module.h"

namespace volalign {

/// The weights that are validated and shipped: an exponential running mean of the weights in
/// training. Its decay rises with the number of steps to the given one, so that it forgets the
/// random start early. With decay 0 they are the weights in training themselves.
class WeightAverage {
 public:
  /// `net` has the options of the network in training; `source` has that network's weights.
  WeightAverage(StructureNet net, double decay, FlatModule& source);

  /// To be called after each step; `steps` includes that one. If `finite`, a bool scalar on the
  /// device, is defined and false, nothing changes.
  void Update(FlatModule& source, std::int64_t steps, const at::Tensor& finite = {});
  /// With decay 0, copies the present weights, before net() is used. Else does nothing.
  void Refresh(FlatModule& source);
  /// Starts again from these weights.
  void Reset(FlatModule& source);

  StructureNet& net() { return net_; }
  const StructureNet& net() const { return net_; }

 private:
  StructureNet net_;
  FlatModule flat_;
  double decay_;
};

}  // namespace volalign
