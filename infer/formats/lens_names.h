#pragma once

#include <string>
#include <vector>

namespace volalign::formats_internal {

/// The coefficients, in OpenCV's order and at most eight, of a lens with the name `model` of ROS or
/// RealSense; "" is OpenCV's own. A lens without any effect may have any name. Throws DataError,
/// which `name` begins, for other models, and for more than eight coefficients unless the rest is
/// 0.
std::vector<double> NamedLens(const std::string& model, const std::vector<double>& numbers,
                              const std::string& name);

}  // namespace volalign::formats_internal
