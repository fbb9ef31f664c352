#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/camera.h"
#include "core/image.h"
#include "infer/view/sensor_frame.h"

namespace volalign {

/// A depth map with its rays: what every geometric step of calibration works on.
struct SensorView {
  DepthImage depth;              ///< m; 0 where nothing usable was measured
  RayTable rays;                 ///< finite everywhere
  double pixel_solid_angle = 0;  ///< 1 / (fx fy): area of a pixel on the plane z = 1

  int width() const { return depth.width(); }
  int height() const { return depth.height(); }
  /// Point of a pixel in the sensor frame, m.
  Eigen::Vector3d Point(int u, int v) const {
    const Eigen::Vector2f& ray = rays.at(u, v);
    const double z = depth(u, v);
    return {z * ray.x(), z * ray.y(), z};
  }
  /// Surface area, m^2, that a pixel at p covers on a surface of this unit normal: z^2 / (fx fy
  /// |n.r|), r = p / z (facts/sensors.md section 6); the incidence is limited to 85 deg.
  double PixelArea(const Eigen::Vector3d& p, const Eigen::Vector3d& normal) const;
};

/// Drops depths that are not finite and positive, and those of pixels without a ray. Throws
/// DataError if the image and the intrinsics differ in size.
SensorView MakeSensorView(const DepthImage& depth, const Intrinsics& intrinsics);

/// MakeSensorView of every frame, on `threads` threads.
std::vector<SensorView> MakeSensorViews(const std::vector<SensorFrame>& frames, int threads);

/// The view with every measured depth z replaced by z * scale + offset (m).
SensorView Corrected(SensorView view, double scale, double offset);

/// Every `stride`-th pixel of every `stride`-th row, from stride / 2 on.
SensorView Decimate(const SensorView& view, int stride);
template <class T>
Image<T> DecimateImage(const Image<T>& image, int stride) {
  const int first = stride / 2;
  Image<T> out((image.width() - first + stride - 1) / stride,
               (image.height() - first + stride - 1) / stride);
  for (int v = 0; v < out.height(); ++v) {
    for (int u = 0; u < out.width(); ++u) out(u, v) = image(first + u * stride, first + v * stride);
  }
  return out;
}

/// Two neighbouring depths that differ by more than this, m, belong to different surfaces unless
/// one is seen at over ~80 deg.
inline double DepthJump(double z) { return 0.03 + 0.015 * z; }

}  // namespace volalign
