#include "train/distributed/gradient_reducer.h"

#include <torch/csrc/autograd/function_hook.h>

namespace volalign {
namespace {

/// Called when a parameter's gradient has been accumulated.
class AfterGradient : public torch::autograd::FunctionPostHook {
 public:
  explicit AfterGradient(std::function<void()> call) : call_(std::move(call)) {}
  torch::autograd::variable_list operator()(
      const torch::autograd::variable_list& outputs,
      const torch::autograd::variable_list& /*inputs*/) override {
    call_();
    return outputs;
  }

 private:
  std::function<void()> call_;
};

}  // namespace

GradientReducer::GradientReducer(FlatModule* module, ProcessGroup* group,
                                 std::int64_t bucket_values)
    : module_(module), group_(group) {
  AddBuckets(bucket_values);
  Hook();
}

GradientReducer::~GradientReducer() {
  for (const auto& [node, key] : hooks_) node->del_post_hook(key);
}

/// Convolution weights from the last layer to the first, then everything else, which is little and
/// complete only at the end.
void GradientReducer::AddBuckets(std::int64_t bucket_values) {
  const std::vector<at::Tensor>& tensors = module_->tensors();
  bucket_of_.resize(tensors.size());
  std::size_t weights = 0;
  while (weights < tensors.size() && module_->offset(weights) < module_->num_weights()) ++weights;
  std::int64_t end = module_->num_weights(), begin = end;
  int parameters = 0;
  const auto close = [&] {
    if (parameters == 0) return;
    buckets_.push_back({module_->gradients().narrow(0, begin, end - begin), parameters, 0});
    end = begin;
    parameters = 0;
  };
  for (std::size_t i = weights; i-- > 0;) {
    begin = module_->offset(i);
    bucket_of_[i] = buckets_.size();
    ++parameters;
    if (end - begin >= bucket_values) close();
  }
  close();
  begin = module_->num_weights();
  end = module_->gradients().numel();
  parameters = static_cast<int>(tensors.size() - weights);
  for (std::size_t i = weights; i < tensors.size(); ++i) bucket_of_[i] = buckets_.size();
  close();
}

void GradientReducer::Hook() {
  for (std::size_t i = 0; i < bucket_of_.size(); ++i) {
    const NodePointer node = torch::autograd::impl::grad_accumulator(module_->tensors()[i]);
    const std::uintptr_t key = node->add_post_hook(
        std::make_unique<AfterGradient>([this, bucket = bucket_of_[i]] { Ready(bucket); }));
    hooks_.emplace_back(node, key);
  }
}

void GradientReducer::Arm() {
  for (Bucket& bucket : buckets_) bucket.missing = bucket.parameters;
  launched_.clear();
  armed_ = true;
}

void GradientReducer::Ready(std::size_t bucket) {
  if (!armed_) return;
  --buckets_[bucket].missing;
  Launch();
}

void GradientReducer::Launch() {
  while (launched_.size() < buckets_.size() && buckets_[launched_.size()].missing <= 0) {
    launched_.push_back(group_->BeginSum(buckets_[launched_.size()].gradients));
  }
}

void GradientReducer::Finish() {
  armed_ = false;
  // What the loss does not depend on has had no call.
  for (Bucket& bucket : buckets_) bucket.missing = 0;
  Launch();
  for (const std::function<void()>& wait : launched_) wait();
  launched_.clear();
}

}  // namespace volalign
