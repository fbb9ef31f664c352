#pragma once

#include <vector>

#include "core/geometry/structure.h"

namespace volalign {

/// Do the sides with these labels fix six degrees of freedom? Their keypoints do if the second
/// singular value of the centred set exceeds 5 cm (core/geometry/procrustes.h). Else their planes
/// do if the normal equations of point-to-plane distances have rank 6. Every eigenvalue then
/// exceeds 0.3 % of the trace, with rotations in units of the sides' extent.
bool SidesFixPose(const Structure& structure, const std::vector<int>& labels);

}  // namespace volalign
