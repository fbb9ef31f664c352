#include "train/soft_procrustes.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/bmm.h>
#include <ATen/ops/cat.h>
#include <ATen/ops/empty.h>
#include <ATen/ops/eye.h>
#include <ATen/ops/isfinite.h>
#include <ATen/ops/linalg_det.h>
#include <ATen/ops/linalg_eigvalsh.h>
#include <ATen/ops/linalg_svd.h>
#include <ATen/ops/ones_like.h>
#include <ATen/ops/stack.h>
#include <ATen/ops/where.h>
#include <ATen/ops/zeros_like.h>
#include <torch/csrc/autograd/custom_function.h>

#include "core/geometry/procrustes.h"

namespace volalign {
namespace {

/// Least (s2 + d s3) / s1 of a determined rotation. The derivative grows with its inverse, and
/// float32 keypoints are no more precise.
constexpr double kMinSigmaSum = 1e-3;

struct SignedSvd {
  at::Tensor u;      ///< [B,3,3], U' = U D
  at::Tensor sigma;  ///< [B,3], (s1, s2, d s3)
  at::Tensor vt;     ///< [B,3,3]
};

/// M = U' diag(sigma) V^T with U' V^T proper. `m` is finite, float64.
SignedSvd DecomposeSigned(const at::Tensor& m) {
  auto [u, s, vt] = at::linalg_svd(m, /*full_matrices=*/true);
  const at::Tensor d = at::linalg_det(u) * at::linalg_det(vt);  // [B], +-1
  const at::Tensor sign = at::where(d < 0, -at::ones_like(d), at::ones_like(d));
  const at::Tensor ones = at::ones_like(sign);
  const at::Tensor diagonal = at::stack({ones, ones, sign}, 1);  // [B,3]
  return {u * diagonal.unsqueeze(1), s * diagonal, vt};
}

at::Tensor FiniteOrIdentity(const at::Tensor& m) {
  const at::Tensor finite = at::isfinite(m).flatten(1).all(1).view({-1, 1, 1});
  return at::where(finite, m, at::eye(3, m.options()).expand_as(m));
}

at::Tensor Determined(const at::Tensor& sigma) {
  const at::Tensor s1 = sigma.select(1, 0);
  return (s1 > 0).logical_and(sigma.select(1, 1) + sigma.select(1, 2) >= kMinSigmaSum * s1);
}

class RotationFunction : public torch::autograd::Function<RotationFunction> {
 public:
  /// The members of ProcrustesFit.
  static torch::autograd::variable_list forward(torch::autograd::AutogradContext* context,
                                                const at::Tensor& m) {
    const at::Tensor wide = m.to(at::kDouble);
    const SignedSvd svd = DecomposeSigned(FiniteOrIdentity(wide));
    const at::Tensor determined =
        Determined(svd.sigma).logical_and(at::isfinite(wide).flatten(1).all(1));
    context->save_for_backward({svd.u, svd.sigma, svd.vt});
    context->mark_non_differentiable({determined});
    context->saved_data["type"] = static_cast<std::int64_t>(m.scalar_type());
    return {at::bmm(svd.u, svd.vt).to(m.scalar_type()), determined};
  }

  static torch::autograd::variable_list backward(torch::autograd::AutogradContext* context,
                                                 torch::autograd::variable_list grads) {
    const auto saved = context->get_saved_variables();
    const at::Tensor &u = saved[0], &sigma = saved[1], &vt = saved[2];
    // Scaling M does not change R. So this works on M / s1 and undoes the scale at the end.
    const at::Tensor s1 = sigma.select(1, 0).clamp_min(1e-300).view({-1, 1, 1});
    const at::Tensor scaled = sigma / s1.squeeze(2);
    const at::Tensor sums = (scaled.unsqueeze(2) + scaled.unsqueeze(1)).clamp_min(kMinSigmaSum);
    const at::Tensor g = grads[0].to(at::kDouble);
    const at::Tensor y = at::bmm(at::bmm(u.transpose(1, 2), g), vt.transpose(1, 2));
    const at::Tensor z = (y - y.transpose(1, 2)) / sums;  // [B,3,3], zero diagonal
    const at::Tensor grad = at::bmm(at::bmm(u, z), vt) / s1;
    const at::Tensor keep = Determined(sigma).view({-1, 1, 1});
    const auto type = static_cast<at::ScalarType>(context->saved_data["type"].toInt());
    return {at::where(keep, grad, at::zeros_like(grad)).to(type)};
  }
};

}  // namespace

at::Tensor Deproject(const at::Tensor& depth, const at::Tensor& rays) {
  return at::cat({depth * rays.to(depth.options()), depth}, 1);
}

at::Tensor SoftKeypoints(const at::Tensor& log_probs, const at::Tensor& points) {
  const at::Tensor valid = (points.narrow(1, 2, 1) > 0).to(points.scalar_type());
  const at::Tensor x = at::cat({points, valid}, 1).flatten(2).transpose(1, 2);  // [B,HW,4]
  const at::Tensor p = log_probs.narrow(1, 1, log_probs.size(1) - 1).flatten(2).exp();
  const at::Tensor sums = at::bmm(p, x);  // [B,K-1,4]
  return sums.narrow(2, 0, 3) / sums.narrow(2, 3, 1).clamp_min(kMinProbability);
}

ProcrustesFit FitRotation(const at::Tensor& m) {
  const torch::autograd::variable_list fit = RotationFunction::apply(m);
  return {fit[0], fit[1]};
}

at::Tensor StructureKeypoints(const Structure& structure, KeypointKind kind) {
  const int sides = structure.num_classes() - 1;
  at::Tensor keypoints = at::empty({sides, 3}, at::kFloat);
  auto rows = keypoints.accessor<float, 2>();
  for (int k = 0; k < sides; ++k) {
    const Eigen::Vector3d& p = structure.Keypoint(k + 1, kind);
    for (int i = 0; i < 3; ++i) rows[k][i] = static_cast<float>(p[i]);
  }
  return keypoints;
}

ProcrustesLoss SoftProcrustesLoss(const at::Tensor& keypoints, const at::Tensor& targets,
                                  const at::Tensor& visible) {
  const at::Tensor known =  // [B,K-1,4], in one transfer
      at::cat({keypoints, visible.unsqueeze(2).to(keypoints.scalar_type())}, 2)
          .to(at::kCPU, at::kDouble);
  const at::Tensor mask = known.narrow(2, 3, 1).detach();               // [B,K-1,1]
  const at::Tensor count = mask.sum(1, /*keepdim=*/true).clamp_min(1);  // [B,1,1]
  const auto centre = [&](const at::Tensor& points) {                   // [B,K-1,3]
    return (points - (points * mask).sum(1, true) / count) * mask;
  };
  const at::Tensor c = centre(known.narrow(2, 0, 3));
  const at::Tensor s = centre(targets.to(at::kCPU, at::kDouble).unsqueeze(0).expand_as(c));
  const ProcrustesFit fit = FitRotation(at::bmm(s.transpose(1, 2), c));  // of sum_k S_k C_k^T
  // The second singular value of the visible sides' keypoints, squared.
  const at::Tensor spread = at::linalg_eigvalsh(at::bmm(s.transpose(1, 2), s)).select(1, 1);
  constexpr double kLeast = kMinSecondSingularValue * kMinSecondSingularValue;
  const at::Tensor fixed = (spread >= kLeast).logical_and(fit.determined);  // [B]
  const at::Tensor residual = s - at::bmm(c, fit.rotation.transpose(1, 2));
  // The norm's gradient at 0 is defined as 0: the clamp cuts it off.
  const at::Tensor norm = residual.square().sum({1, 2}).clamp_min(1e-20).sqrt();  // [B]
  const at::Tensor kept = at::where(fixed, norm, at::zeros_like(norm));
  const double batch = static_cast<double>(keypoints.size(0));
  const auto back = [&](const at::Tensor& x, at::ScalarType type) {
    return x.to(keypoints.device(), type, /*non_blocking=*/true);
  };
  return {back(kept.sum() / batch, keypoints.scalar_type()),
          back(fixed.logical_not().sum(), at::kLong)};
}

}  // namespace volalign
