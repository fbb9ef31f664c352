#pragma once

#include <string>
#include <vector>

#include "core/geometry/pose.h"
#include "infer/calib/result.h"

namespace volalign {

/// Covariances of sensors' poses (of delta, see PerturbLeft) as a second still would leave them in
/// which the stack stands elsewhere and tells each sensor as much again. With x_i the pose of
/// sensor i, s where the stack stands then and A_i the inverse of C_i, the second still adds
/// sum_i (x_i - s)' A_i (x_i - s) to the information sum_i x_i' A_i x_i of the first; without s,
/// and inverted, this is C_i / 2 + inverse(sum_j A_j) / 2. Sensors count as independent, and what
/// a device measures wrong in both stills as if it were drawn anew: it is a lower bound.
/// The covariances have to be positive definite.
std::vector<Matrix6d> WithSecondStill(const std::vector<Matrix6d>& covariances);

/// What to do next, a sentence each; also where every sensor is ok.
std::vector<std::string> Advise(const CalibrationResult& result);

}  // namespace volalign
