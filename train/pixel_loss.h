#pragma once

#include <ATen/core/Tensor.h>

namespace volalign {

/// The training loss's terms over all pixels, computed in one pass over the probabilities in each
/// direction.
struct PixelTerms {
  at::Tensor segmentation;  ///< scalar: SegmentationLoss (losses.h), differentiable
  at::Tensor
      keypoints;  ///< [B,K-1,3]: SoftKeypoints of Deproject (soft_procrustes.h), differentiable
  at::Tensor measured;  ///< int64 [B,K]: number of pixels of each label with depth
};

/// Computes the terms for log_probs [B,K,H,W] float32 on the CPU, labels [B,H,W] int64, depth
/// [B,1,H,W] and rays [B,2,H,W] float32. Throws Error for other shapes, types or labels outside of
/// [0, K).
PixelTerms ComputePixelTerms(const at::Tensor& log_probs, const at::Tensor& labels,
                             const at::Tensor& depth, const at::Tensor& rays);

}  // namespace volalign
