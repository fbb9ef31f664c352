#pragma once

#include <ATen/core/Tensor.h>

#include "core/geometry/structure.h"

namespace volalign {

/// Points V [B,3,H,W] in the sensor frame, m, from depth maps [B,1,H,W], m, whose pixels have the
/// rays (x/z, y/z) [B,2,H,W]. 0 without depth. Type of `depth`.
at::Tensor Deproject(const at::Tensor& depth, const at::Tensor& rays);

/// Below this total probability a keypoint counts as absent. log-softmax in float32 reaches it only
/// at saturation.
inline constexpr double kMinProbability = 1e-12;

/// Soft keypoints C [B,K-1,3] of the labels 1..K-1 (paper, eq. soft_corr): C_k = sum P_k V / sum
/// P_k over the pixels with depth. P = exp(log_probs [B,K,H,W]); `points` [B,3,H,W] are V (z = 0
/// without depth). Differentiable with respect to log_probs.
at::Tensor SoftKeypoints(const at::Tensor& log_probs, const at::Tensor& points);

/// The rotation of a matrix.
struct ProcrustesFit {
  at::Tensor rotation;  ///< [B,3,3], type of the matrices, differentiable
  /// bool [B]: the matrix determines its rotation, (s2 + d s3) / s1 >= 1e-3. M has the singular
  /// values s1 >= s2 >= s3, and d = sign det M. False for M = 0 and for M that is not finite.
  at::Tensor determined;
};

/// The proper rotation R [B,3,3] that maximises tr(R^T M) for M [B,3,3] (orthogonal Procrustes
/// problem). Its closed-form adjoint is dL/dM = U' Z V^T, Z_ij = (Y_ij - Y_ji) / (sigma_i +
/// sigma_j), Y = U'^T dL/dR V. Unlike the backward pass of an SVD it is finite for repeated and
/// vanishing singular values. Computed in float64. The gradient is zero if the rotation is not
/// determined.
ProcrustesFit FitRotation(const at::Tensor& m);

/// Keypoints S [K-1,3] of the labels 1..K-1, structure frame, m, float32 on the CPU.
at::Tensor StructureKeypoints(const Structure& structure, KeypointKind kind);

struct ProcrustesLoss {
  at::Tensor loss;  ///< scalar: sum over the samples / B, m
  /// int64 scalar: samples whose keypoints fix no rotation; they add nothing.
  at::Tensor degenerate_samples;
};

/// The paper's loss (section "Soft Procrustes"): L_3D = ||M . (S^ - Omega C^)||_F per sample. C
/// [B,K-1,3] is in the sensor frame, S [K-1,3] in the structure frame, visible [B,K-1] bool. Both
/// sets are centred over the visible sides; Omega aligns C^ to S^. A degenerate sample adds nothing
/// and is counted. Its visible centred S has a second singular value below kMinSecondSingularValue
/// (core/geometry/procrustes.h), or its rotation is not determined. The gradient is finite for
/// every input, including zero residuals. Computed in float64 on the CPU for any device of the
/// keypoints, on which the results are: cuSOLVER decomposes small matrices one after another.
ProcrustesLoss SoftProcrustesLoss(const at::Tensor& keypoints, const at::Tensor& targets,
                                  const at::Tensor& visible);

}  // namespace volalign
