#include "core/geometry/depth_error_model.h"

#include <cmath>

namespace volalign {

namespace {

constexpr double kReferenceDepth = 2;  // m, reference of white_m and smooth_m

double Growth(double power, double z) { return std::pow(z / kReferenceDepth, power); }

}  // namespace

double DepthErrorModel::White(double z) const { return white_m * Growth(white_power, z); }

double DepthErrorModel::SmoothGrowth(double z) const { return Growth(smooth_power, z); }

double DepthErrorModel::TiltGrowth(double z) const { return Growth(white_power, z); }

double DepthErrorModel::Smooth(double z) const { return smooth_m * SmoothGrowth(z); }

double DepthErrorModel::WithinSurface(double z) const {
  const double seam = seam_m / std::sqrt(3);  // root mean square of a linear fall to 0
  return std::hypot(White(z), Smooth(z), seam);
}

double DepthErrorModel::Sigma(double z) const {
  return std::hypot(WithinSurface(z), offset_m, gain * z);
}

}  // namespace volalign
