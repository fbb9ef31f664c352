#pragma once

#include <string>
#include <vector>

#include "core/geometry/pose.h"
#include "infer/calib/result.h"

namespace volalign {

/// The result as text for a terminal. It has the verdict, and reasons and hints of sensors that are
/// not ok. A table of sensors follows (status, sides, RMS, standard deviations, errors if there is
/// a ground truth), with a line on its columns. Then come the boxes as found, the pairs of sensors,
/// and d1 and d2.
std::string FormatReport(const CalibrationResult& result);

/// Its sentences beside the poses, a line each: both poses of sensors that disagree with the
/// others, the stack's place in each of several captures, and changed lenses.
std::string FormatNotes(const CalibrationResult& result);

/// Covariances of sensors' poses (of delta, see PerturbLeft) after a second capture in which the
/// stack stands elsewhere and is seen as well by each sensor. Let x_i be the pose of sensor i, s
/// the stack's place in it and A_i the inverse of C_i. The second capture adds sum_i (x_i - s)' A_i
/// (x_i - s) to the information sum_i x_i' A_i x_i of the first. Without s, and inverted, this is
/// C_i / 2 + inverse(sum_j A_j) / 2. Sensors count as independent, and a device's errors as drawn
/// anew in the second capture, so it is a lower bound. The covariances have to be positive
/// definite.
std::vector<Matrix6d> WithSecondCapture(const std::vector<Matrix6d>& covariances);

/// Returns the next steps, a sentence each; also if every sensor is ok.
std::vector<std::string> Advise(const CalibrationResult& result);

}  // namespace volalign
