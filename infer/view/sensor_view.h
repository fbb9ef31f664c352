#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "core/camera.h"
#include "core/image.h"
#include "infer/view/sensor_frame.h"

namespace volalign {

/// A frame as geometry: a depth map with the ray of every pixel. Every geometric step of
/// calibration works on it.
struct SensorView {
  DepthImage depth;              ///< m; 0 where nothing usable was measured
  Image<float> depth_sigma;      ///< m, see SensorFrame; may be empty
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
  /// |n . r|) with r = p / z. The angle of incidence is limited to 85 deg.
  double PixelArea(const Eigen::Vector3d& p, const Eigen::Vector3d& normal) const;
};

/// The view of a frame, without depths that are not finite and positive and without those of pixels
/// that have no ray. Throws DataError if the image and the intrinsics differ in size.
SensorView MakeSensorView(const DepthImage& depth, const Intrinsics& intrinsics);

/// MakeSensorView of every frame, on `threads` threads, with the frames' depth_sigma. Throws
/// DataError also where that is of another size.
std::vector<SensorView> MakeSensorViews(const std::vector<SensorFrame>& frames, int threads);

/// The view with every measured depth z replaced by z * gain + offset (m).
SensorView Corrected(SensorView view, double gain, double offset);

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

/// Rays that suffice to tell good poses from bad ones. A full frame has ten times as many.
inline constexpr double kCoarseRays = 10000;

/// The stride that leaves about `rays` of so many pixels, at least that number; 1 where there are
/// fewer.
int StrideForRays(std::size_t pixels, double rays);

/// Two neighbouring depths that differ by more than this, m, belong to different surfaces unless
/// one is seen at over ~80 deg.
inline double DepthJump(double z) { return 0.03 + 0.015 * z; }

}  // namespace volalign
