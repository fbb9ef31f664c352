#pragma once

#include <vector>

#include "core/geometry/structure.h"

namespace volalign {

/// Do these sides, by their labels, fix six degrees of freedom? By their keypoints, which do where
/// the second singular value of the centred set exceeds 5 cm (core/geometry/procrustes.h); or,
/// where these do not, by their planes: the normal equations of point-to-plane distances have rank
/// 6, every eigenvalue above 0.3 % of the trace, with rotations measured in units of the sides'
/// extent.
bool SidesFixPose(const Structure& structure, const std::vector<int>& labels);

}  // namespace volalign
