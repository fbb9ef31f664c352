#include "train/averaging.h"

#include <ATen/TensorOperators.h>
#include <c10/core/GradMode.h>

#include <algorithm>
#include <utility>

namespace volalign {

WeightAverage::WeightAverage(StructureNet net, double decay, FlatModule& source)
    : net_(std::move(net)), flat_(*net_), decay_(decay) {
  Reset(source);
}

void WeightAverage::Update(FlatModule& source, std::int64_t steps, const at::Tensor& finite) {
  if (decay_ == 0) return;
  c10::NoGradGuard no_grad;
  const double t = static_cast<double>(steps);
  const double weight = 1 - std::min(decay_, (1 + t) / (10 + t));
  if (finite.defined()) {
    const at::Tensor share = finite.to(at::kFloat) * weight;
    flat_.parameters().lerp_(source.parameters(), share);
    flat_.buffers().lerp_(source.buffers(), share);
    return;
  }
  flat_.parameters().lerp_(source.parameters(), weight);
  flat_.buffers().lerp_(source.buffers(), weight);
}

void WeightAverage::Refresh(FlatModule& source) {
  if (decay_ == 0) Reset(source);
}

void WeightAverage::Reset(FlatModule& source) {
  c10::NoGradGuard no_grad;
  flat_.parameters().copy_(source.parameters());
  flat_.buffers().copy_(source.buffers());
}

}  // namespace volalign
