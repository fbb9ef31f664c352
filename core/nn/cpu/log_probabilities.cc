#include "core/nn/cpu/log_probabilities.h"

#include <ATen/ops/empty.h>
#include <torch/csrc/autograd/custom_function.h>

#include "core/nn/cpu/map_pass.h"
#include "core/nn/simd/map_kernels.h"

namespace volalign {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

class LogSoftmaxFunction : public torch::autograd::Function<LogSoftmaxFunction> {
 public:
  static at::Tensor forward(AutogradContext* context, const at::Tensor& given) {
    const at::Tensor logits = given.contiguous(at::MemoryFormat::ChannelsLast);
    const std::int64_t classes = logits.size(1), plane = logits.size(2) * logits.size(3);
    at::Tensor result = at::empty(logits.sizes(), at::kFloat);
    ForMapParts(logits.size(0), plane,
                [&](std::int64_t s, std::int64_t, std::int64_t begin, std::int64_t end) {
                  simd::Kernels().log_softmax(SampleData(logits, s), IsBf16(logits), begin, end,
                                              classes, plane,
                                              result.data_ptr<float>() + s * classes * plane);
                });
    context->save_for_backward({result});
    context->saved_data["type"] = static_cast<std::int64_t>(logits.scalar_type());
    return result;
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const at::Tensor result = context->get_saved_variables()[0],
                     gradient = gradients[0].contiguous();
    const std::int64_t samples = result.size(0), classes = result.size(1),
                       plane = result.size(2) * result.size(3);
    const auto type = static_cast<at::ScalarType>(context->saved_data["type"].toInt());
    const at::Tensor of_logits =
        EmptyMap({samples, classes, result.size(2), result.size(3)}, classes, type);
    ForMapParts(samples, plane,
                [&](std::int64_t s, std::int64_t, std::int64_t begin, std::int64_t end) {
                  const std::int64_t first = s * classes * plane;
                  simd::Kernels().log_softmax_gradient(
                      result.data_ptr<float>() + first, gradient.data_ptr<float>() + first, begin,
                      end, classes, plane, SampleData(of_logits, s), type == at::kBFloat16);
                });
    return {of_logits};
  }
};

}  // namespace

at::Tensor LogProbabilities(const at::Tensor& logits) { return LogSoftmaxFunction::apply(logits); }

}  // namespace volalign
