#include "infer/view/sensor_view.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/error.h"
#include "core/lens.h"
#include "core/parallel_for.h"

namespace volalign {

namespace {

constexpr double kGrazing = 0.087;  // cos 85 deg: pixels at larger angles count as this one
constexpr float kNearest = 1e-3f;   // m: a corrected depth is a depth still

}  // namespace

double SensorView::PixelArea(const Eigen::Vector3d& p, const Eigen::Vector3d& normal) const {
  const double z = p.z();
  const double cosine = std::max(std::abs(normal.dot(p)) / p.norm(), kGrazing);
  return z * z * z * pixel_solid_angle / (p.norm() * cosine);
}

SensorView MakeSensorView(const DepthImage& depth, const Intrinsics& intrinsics) {
  if (depth.width() != intrinsics.width || depth.height() != intrinsics.height) {
    throw DataError(fmt::format(
        "the depth map is {}x{} but the intrinsics are for {}x{}; give those of this resolution",
        depth.width(), depth.height(), intrinsics.width, intrinsics.height));
  }
  SensorView view;
  view.depth = depth;
  view.rays = ComputeRays(intrinsics);
  view.pixel_solid_angle = 1 / (intrinsics.fx * intrinsics.fy);
  for (std::size_t i = 0; i < view.depth.size(); ++i) {
    const bool has_ray = view.rays.rays[i].allFinite();
    if (!has_ray) view.rays.rays[i].setZero();
    if (!has_ray || !(view.depth[i] > 0) || !std::isfinite(view.depth[i])) view.depth[i] = 0;
  }
  return view;
}

std::vector<SensorView> MakeSensorViews(const std::vector<SensorFrame>& frames, int threads) {
  std::vector<SensorView> views(frames.size());
  ParallelFor(frames.size(), threads, [&](std::size_t i) {
    const SensorFrame& frame = frames[i];
    views[i] = MakeSensorView(frame.depth, frame.intrinsics);
    if (frame.depth_sigma.empty()) return;
    if (frame.depth_sigma.width() != frame.depth.width() ||
        frame.depth_sigma.height() != frame.depth.height()) {
      throw DataError(
          fmt::format("{}: the standard errors are not of the depth map's size", frame.name));
    }
    views[i].depth_sigma = frame.depth_sigma;
  });
  return views;
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
  small.pixel_solid_angle = view.pixel_solid_angle * stride * stride;
  return small;
}

int StrideForRays(std::size_t pixels, double rays) {
  return std::max(1, static_cast<int>(std::floor(std::sqrt(static_cast<double>(pixels) / rays))));
}

}  // namespace volalign
