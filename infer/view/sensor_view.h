#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>

#include "core/base/image.h"
#include "core/geometry/camera.h"
#include "core/geometry/sensor_kind.h"
#include "infer/view/sensor_frame.h"

namespace volalign {

/// A frame as geometry: a depth map with the ray of every pixel. Every geometric step of
/// calibration works on it.
struct SensorView {
  DepthImage depth;          ///< m; 0 where nothing usable was measured
  Image<float> depth_sigma;  ///< m, see SensorFrame; may be empty
  RayTable rays;             ///< finite everywhere
  /// The area that each pixel covers on the plane z = 1, m^2: 1 / (fx fy |J|). J is the lens's
  /// derivative at the pixel's ray (BendRay). 0 if it has no ray.
  Image<float> ray_areas;
  DepthErrorModel errors = ErrorsOf("");  ///< of the sensor's kind

  int width() const { return depth.width(); }
  int height() const { return depth.height(); }
  /// The ray of a pixel, of unit depth, in the sensor frame.
  Eigen::Vector3d Ray(int u, int v) const { return rays.at(u, v).cast<double>().homogeneous(); }
  /// Point of a pixel in the sensor frame, m.
  Eigen::Vector3d Point(int u, int v) const { return static_cast<double>(depth(u, v)) * Ray(u, v); }
  /// Calls visit(u, v) for the pixels with depth, row by row: every `stride`-th pixel of every
  /// `stride`-th row, beginning at stride / 2.
  template <class Visit>
  void VisitMeasured(int stride, const Visit& visit) const {
    for (int v = stride / 2; v < height(); v += stride) {
      for (int u = stride / 2; u < width(); u += stride) {
        if (depth(u, v) > 0) visit(u, v);
      }
    }
  }
  /// Area, m^2, that a pixel covers at the depth z on a surface with this unit normal: z^2 a / |n .
  /// r|. Its ray is r = (x/z, y/z, 1), and a is its area on the plane z = 1. The angle of incidence
  /// is limited to 85 deg.
  double PixelArea(int u, int v, double z, const Eigen::Vector3d& normal) const;
};

/// The view of a frame, by default of an unknown kind. Depths that are not finite and positive
/// become 0, as do those of pixels without a ray. Throws DataError if the image and the intrinsics
/// differ in size.
SensorView MakeSensorView(const DepthImage& depth, const Intrinsics& intrinsics,
                          const DepthErrorModel& errors = ErrorsOf(""));

/// The depth errors that calibration assumes of a frame before it fits them. They are those of the
/// sensor's kind (a name of the intrinsics pool, see SensorFrame::sensor), but with the smooth part
/// of an unknown kind. A D415 has twice that smooth error, growing with the square of the depth.
/// But with its own values, eight stereo cameras of a rig from another simulator were 3.1 mm off in
/// the median instead of 2.5 mm.
DepthErrorModel PriorErrorsOf(const std::string& sensor);

/// The view of a frame with its depth_sigma, through these intrinsics instead of its own. Throws
/// DataError also if depth_sigma has another size.
SensorView MakeSensorView(const SensorFrame& frame, const Intrinsics& intrinsics);

/// The view with every measured depth z replaced by z * gain + offset (m).
SensorView Corrected(SensorView view, double gain, double offset);

/// Every `stride`-th pixel of every `stride`-th row, beginning at stride / 2.
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

/// Number of rays that suffices to distinguish good poses from bad ones. A full frame has ten times
/// as many.
inline constexpr double kCoarseRays = 10000;

/// The largest stride that leaves at least about `rays` of so many pixels; 1 if there are fewer.
int StrideForRays(std::size_t pixels, double rays);

/// Two neighbouring depths that differ by more than this, m, belong to different surfaces unless
/// one is seen at over ~80 deg.
inline double DepthJump(double z) { return 0.03 + 0.015 * z; }

}  // namespace volalign
