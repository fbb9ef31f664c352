#pragma once

#include <ATen/core/Tensor.h>
#include <torch/csrc/autograd/function.h>
#include <torch/csrc/autograd/variable.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "train/distributed/flat_module.h"
#include "train/distributed/process_group.h"

namespace volalign {

/// Sums the gradients of the processes while backward() goes on: in buckets of neighbouring
/// parameters, the last layers first, each as soon as all its gradients are there. All processes
/// exchange the buckets in the same order.
class GradientReducer {
 public:
  static constexpr std::int64_t kBucketValues = 1 << 20;

  /// Both outlive this object.
  GradientReducer(FlatModule* module, ProcessGroup* group,
                  std::int64_t bucket_values = kBucketValues);
  ~GradientReducer();
  GradientReducer(const GradientReducer&) = delete;
  GradientReducer& operator=(const GradientReducer&) = delete;

  /// The next backward() completes the gradient of this process.
  void Arm();
  /// After that backward(): waits until module->gradients() is the sum.
  void Finish();

  std::size_t num_buckets() const { return buckets_.size(); }
  ProcessGroup& group() { return *group_; }

 private:
  struct Bucket {
    at::Tensor gradients;  ///< a view of the module's
    int parameters = 0;
    int missing = 0;  ///< of them, in the backward() that goes on
  };
  void AddBuckets(std::int64_t bucket_values);
  void Hook();
  void Ready(std::size_t bucket);
  void Launch();

  FlatModule* module_;
  ProcessGroup* group_;
  std::vector<Bucket> buckets_;         ///< in the order of their exchange
  std::vector<std::size_t> bucket_of_;  ///< each parameter's
  /// A shared_ptr or, since LibTorch 2.15, an intrusive_ptr.
  using NodePointer =
      decltype(torch::autograd::impl::grad_accumulator(std::declval<const at::Tensor&>()));
  std::vector<std::pair<NodePointer, std::uintptr_t>> hooks_;
  bool armed_ = false;
  std::vector<std::function<void()>> launched_;  ///< that wait for the first buckets
};

}  // namespace volalign
