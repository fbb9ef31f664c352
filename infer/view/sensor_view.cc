#include "infer/view/sensor_view.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "core/base/error.h"
#include "core/geometry/lens.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

constexpr auto kNearest = static_cast<float>(kDepthStep);  // m: a corrected depth stays a depth

/// Areas for finite rays; 0 elsewhere.
Image<float> RayAreas(const Intrinsics& intrinsics, const RayTable& rays) {
  Image<float> areas(rays.width, rays.height);
  for (std::size_t i = 0; i < areas.size(); ++i) {
    if (!rays.rays[i].allFinite()) continue;
    const BentRay bent = BendRay(intrinsics, rays.rays[i].cast<double>());
    areas[i] = static_cast<float>(1 / (intrinsics.fx * intrinsics.fy * bent.by_ray.determinant()));
  }
  return areas;
}

}  // namespace

double SensorView::PixelArea(int u, int v, double z, const Eigen::Vector3d& normal) const {
  const Eigen::Vector3d ray = Ray(u, v);
  return z * z * ray_areas(u, v) / std::max(std::abs(normal.dot(ray)), kGrazing * ray.norm());
}

SensorView MakeSensorView(const DepthImage& depth, const Intrinsics& intrinsics,
                          const DepthErrorModel& errors) {
  if (depth.width() != intrinsics.width || depth.height() != intrinsics.height) {
    throw DataError(fmt::format(
        "the depth map is {}x{} but the intrinsics are for {}x{}; give those of this resolution",
        depth.width(), depth.height(), intrinsics.width, intrinsics.height));
  }
  SensorView view;
  view.depth = depth;
  view.errors = errors;
  view.rays = ComputeRays(intrinsics);
  view.ray_areas = RayAreas(intrinsics, view.rays);
  for (std::size_t i = 0; i < view.depth.size(); ++i) {
    const bool has_ray = view.rays.rays[i].allFinite();
    if (!has_ray) view.rays.rays[i].setZero();
    if (!has_ray || !(view.depth[i] > 0) || !std::isfinite(view.depth[i])) view.depth[i] = 0;
  }
  return view;
}

DepthErrorModel PriorErrorsOf(const std::string& sensor) {
  DepthErrorModel errors = ErrorsOf(sensor);
  const DepthErrorModel unknown = ErrorsOf("");
  errors.smooth_m = unknown.smooth_m;
  errors.smooth_power = unknown.smooth_power;
  return errors;
}

SensorView MakeSensorView(const SensorFrame& frame, const Intrinsics& intrinsics) {
  SensorView view = MakeSensorView(frame.depth, intrinsics, PriorErrorsOf(frame.sensor));
  if (frame.depth_sigma.empty()) return view;
  if (frame.depth_sigma.width() != frame.depth.width() ||
      frame.depth_sigma.height() != frame.depth.height()) {
    throw DataError(
        fmt::format("{}: the standard errors are not of the depth map's size", frame.name));
  }
  view.depth_sigma = frame.depth_sigma;
  return view;
}

SensorView Corrected(SensorView view, double gain, double offset) {
  for (float& z : view.depth) {
    if (z > 0) z = std::max(static_cast<float>(z * gain + offset), kNearest);
  }
  return view;
}

SensorView Decimate(const SensorView& view, int stride) {
  if (stride <= 1) return view;
  SensorView small;
  small.errors = view.errors;
  small.depth = DecimateImage(view.depth, stride);
  if (!view.depth_sigma.empty()) small.depth_sigma = DecimateImage(view.depth_sigma, stride);
  small.rays.width = small.depth.width();
  small.rays.height = small.depth.height();
  small.rays.rays.reserve(small.depth.size());
  for (int v = 0; v < small.height(); ++v) {
    for (int u = 0; u < small.width(); ++u) {
      small.rays.rays.push_back(view.rays.at(stride / 2 + u * stride, stride / 2 + v * stride));
    }
  }
  small.ray_areas = DecimateImage(view.ray_areas, stride);
  for (float& area : small.ray_areas) area *= static_cast<float>(stride * stride);
  return small;
}

int StrideForRays(std::size_t pixels, double rays) {
  return std::max(1, static_cast<int>(std::floor(std::sqrt(static_cast<double>(pixels) / rays))));
}

}  // namespace volalign
