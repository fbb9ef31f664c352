#include "train/distributed/flat_module.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/zeros.h>
#include <c10/core/GradMode.h>

#include <algorithm>

namespace volalign {
namespace {

/// Number of float32 values in a slot for so many.
std::int64_t SlotValues(std::int64_t values) {
  constexpr std::int64_t kMultiple = FlatModule::kSlotBytes / sizeof(float);
  return (values + kMultiple - 1) / kMultiple * kMultiple;
}

}  // namespace

FlatModule::FlatModule(torch::nn::Module& module) {
  c10::NoGradGuard no_grad;
  std::vector<std::pair<std::string, at::Tensor>> ordered;
  for (const auto& item : module.named_parameters()) ordered.emplace_back(item.key(), item.value());
  std::stable_partition(ordered.begin(), ordered.end(),
                        [](const auto& item) { return item.second.dim() > 1; });
  std::int64_t total = 0;
  for (const auto& [name, p] : ordered) {
    slots_.push_back({name, total, p.sizes().vec()});
    total += SlotValues(p.numel());
    if (p.dim() > 1) num_weights_ = total;
  }
  const at::TensorOptions options =
      at::TensorOptions(at::kFloat).device(ordered.at(0).second.device());
  parameters_ = at::zeros({total}, options);
  gradients_ = at::zeros({total}, options);
  for (std::size_t i = 0; i < ordered.size(); ++i) {
    at::Tensor& p = ordered[i].second;
    const at::Tensor view = parameters_.narrow(0, slots_[i].offset, p.numel()).view(p.sizes());
    view.copy_(p);
    p.set_data(view);
    p.mutable_grad() = gradients_.narrow(0, slots_[i].offset, p.numel()).view(p.sizes());
  }

  std::vector<at::Tensor> buffers = module.buffers();
  std::int64_t values = 0;
  for (const at::Tensor& b : buffers) values += SlotValues(b.numel());
  buffers_ = at::zeros({values}, options);
  std::int64_t offset = 0;
  for (at::Tensor& b : buffers) {
    const at::Tensor view = buffers_.narrow(0, offset, b.numel()).view(b.sizes());
    view.copy_(b);
    b.set_data(view);
    offset += SlotValues(b.numel());
  }
}

void FlatModule::AddViews(const at::Tensor& flat, const std::string& prefix,
                          std::map<std::string, at::Tensor>* tensors) const {
  for (const Slot& slot : slots_) {
    std::int64_t count = 1;
    for (std::int64_t size : slot.sizes) count *= size;
    tensors->emplace(prefix + slot.name, flat.narrow(0, slot.offset, count).view(slot.sizes));
  }
}

}  // namespace volalign
