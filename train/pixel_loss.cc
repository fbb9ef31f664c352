#include "train/pixel_loss.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/empty.h>
#include <ATen/ops/empty_like.h>
#include <ATen/ops/zeros.h>
#include <torch/csrc/autograd/custom_function.h>

#include "core/base/error.h"
#include "core/nn/cpu/torch_threads.h"
#include "core/nn/simd/map_kernels.h"
#include "train/soft_procrustes.h"

namespace volalign {
namespace {

using simd::PixelSums;
using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

/// Number of parts of a sample, for any number of threads. So sums do not depend on threads.
constexpr std::int64_t kParts = 4;

void Require(bool holds, const char* what) {
  if (!holds) throw Error(std::string("ComputePixelTerms: ") + what);
}

struct Pixels {
  at::Tensor log_probs, labels, depth, rays;

  std::int64_t samples() const { return log_probs.size(0); }
  std::int64_t classes() const { return log_probs.size(1); }
  std::int64_t plane() const { return log_probs.size(2) * log_probs.size(3); }
  PixelSums Of(std::int64_t s) const {
    PixelSums p;
    p.classes = classes();
    p.plane = plane();
    p.log_probs = log_probs.data_ptr<float>() + s * p.classes * p.plane;
    p.depth = depth.data_ptr<float>() + s * p.plane;
    p.rays = rays.data_ptr<float>() + s * 2 * p.plane;
    p.labels = labels.data_ptr<std::int64_t>() + s * p.plane;
    return p;
  }
  /// Calls f(sample, part, first pixel, end) in parallel.
  template <class F>
  void ForParts(const F& f) const {
    ForEachOnTorchThreads(samples() * kParts, [&](std::int64_t i) {
      f(i / kParts, i % kParts, plane() * (i % kParts) / kParts,
        plane() * (i % kParts + 1) / kParts);
    });
  }
};

/// log_probs -> the sums of PixelSums [B,N] float64. [0, 4(K-1)) and the K of the likelihood are
/// differentiable.
class PixelSumsFunction : public torch::autograd::Function<PixelSumsFunction> {
 public:
  static at::Tensor forward(AutogradContext* context, const at::Tensor& log_probs,
                            const at::Tensor& labels, const at::Tensor& depth,
                            const at::Tensor& rays) {
    const Pixels pixels{log_probs, labels, depth, rays};
    const std::int64_t count = PixelSums::Count(pixels.classes());
    const at::Tensor parts = at::zeros({pixels.samples(), kParts, count}, at::kDouble);
    pixels.ForParts([&](std::int64_t s, std::int64_t part, std::int64_t begin, std::int64_t end) {
      simd::Kernels().pixel_sums(pixels.Of(s), begin, end,
                                 parts.data_ptr<double>() + (s * kParts + part) * count);
    });
    Require(parts.select(2, count - 1).sum().item<double>() == 0, "a label is outside [0, K)");
    context->save_for_backward({log_probs, labels, depth, rays});
    return parts.sum(1);
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const auto saved = context->get_saved_variables();
    const Pixels pixels{saved[0], saved[1], saved[2], saved[3]};
    const std::int64_t classes = pixels.classes(), points = 4 * (classes - 1),
                       count = points + classes;
    // The likelihood is -log_probs.
    at::Tensor g = gradients[0].narrow(1, 0, count).to(at::kFloat).contiguous();
    g.narrow(1, points, classes).neg_();
    const at::Tensor result = at::empty_like(pixels.log_probs);
    pixels.ForParts([&](std::int64_t s, std::int64_t, std::int64_t begin, std::int64_t end) {
      const float* of = g.data_ptr<float>() + s * count;
      simd::Kernels().pixel_gradient(pixels.Of(s), begin, end, of, of + points,
                                     result.data_ptr<float>() + s * classes * pixels.plane());
    });
    return {result, {}, {}, {}};
  }
};

}  // namespace

PixelTerms ComputePixelTerms(const at::Tensor& log_probs, const at::Tensor& labels,
                             const at::Tensor& depth, const at::Tensor& rays) {
  Require(log_probs.dim() == 4 && log_probs.size(1) >= 2 && log_probs.scalar_type() == at::kFloat &&
              log_probs.is_cpu(),
          "log_probs is no [B,K,H,W] of float32 on the CPU");
  const std::int64_t b = log_probs.size(0), k = log_probs.size(1), h = log_probs.size(2),
                     w = log_probs.size(3);
  Require(labels.sizes() == at::IntArrayRef({b, h, w}) && labels.scalar_type() == at::kLong,
          "labels are no [B,H,W] of int64");
  Require(depth.sizes() == at::IntArrayRef({b, 1, h, w}) && depth.scalar_type() == at::kFloat,
          "depth is no [B,1,H,W] of float32");
  Require(rays.sizes() == at::IntArrayRef({b, 2, h, w}) && rays.scalar_type() == at::kFloat,
          "rays are no [B,2,H,W] of float32");
  const at::Tensor sums = PixelSumsFunction::apply(log_probs.contiguous(), labels.contiguous(),
                                                   depth.contiguous(), rays.contiguous());
  const at::Tensor soft = sums.narrow(1, 0, 4 * (k - 1)).view({b, k - 1, 4});
  PixelTerms terms;
  terms.segmentation =
      (sums.narrow(1, 4 * (k - 1), k).sum(0).sum() / static_cast<double>(b * h * w)).to(at::kFloat);
  terms.keypoints =
      (soft.narrow(2, 0, 3) / soft.narrow(2, 3, 1).clamp_min(kMinProbability)).to(at::kFloat);
  terms.measured = sums.detach().narrow(1, 6 * k - 4, k).to(at::kLong);
  return terms;
}

}  // namespace volalign
