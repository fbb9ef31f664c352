#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "core/base/image.h"
#include "core/geometry/pose.h"

namespace volalign {

/// Intrinsics in pixels, pixel centres at integer coordinates: u = fx * x/z + cx, v = fy * y/z + cy
/// for a pinhole camera. `distortion` is empty, or has OpenCV's 4, 5 or 8 coefficients of a lens
/// (k1 k2 p1 p2 k3 k4 k5 k6). See core/geometry/lens.h for projection and rays.
struct Intrinsics {
  int width = 0;
  int height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;
  std::vector<double> distortion;

  /// Throws DataError, with `what` in its message, for invalid intrinsics. Sizes and focal lengths
  /// have to be positive, and all numbers finite. The principal point has to lie within one image
  /// size of the image. The number of distortion coefficients has to be 0, 4, 5 or 8.
  void Validate(const std::string& what) const;

  /// For an image resized to width x height: cx' = (cx + .5) s - .5 (integer pixel centres).
  Intrinsics Resized(int new_width, int new_height) const;

  /// For the image turned by `quarter_turns` (core/base/image.h, Turn).
  Intrinsics Turned(int quarter_turns) const;

  friend bool operator==(const Intrinsics& a, const Intrinsics& b);
};

/// Per-pixel ray directions (x/z, y/z), row-major; a point is z * (x/z, y/z, 1). ComputeRays
/// (core/geometry/lens.h) makes it.
struct RayTable {
  int width = 0;
  int height = 0;
  std::vector<Eigen::Vector2f> rays;

  const Eigen::Vector2f& at(int u, int v) const {
    return rays[static_cast<std::size_t>(v) * static_cast<std::size_t>(width) +
                static_cast<std::size_t>(u)];
  }
};

/// A named kind of sensor with measured intrinsics at one resolution (configs/intrinsics.yaml).
struct IntrinsicsPoolEntry {
  std::string sensor;
  std::vector<Intrinsics> intrinsics;  ///< all of one resolution
};

/// Reads the YAML of `configs/intrinsics.yaml`. Throws IoError, or ConfigError (also for unknown
/// keys).
std::vector<IntrinsicsPoolEntry> ReadIntrinsicsPool(const std::string& path);

}  // namespace volalign
