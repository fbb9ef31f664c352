#pragma once

#include <Eigen/Core>
#include <optional>
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

/// The mean intrinsics of the devices of this kind (SensorFrame::sensor) in the pool that the
/// program contains. They are scaled to this resolution, px, without distortion. Nothing for an
/// unknown name, or if the pool has no resolution of this aspect ratio.
std::optional<Intrinsics> TypicalIntrinsics(const std::string& sensor, int width, int height);

/// Intrinsics of the kind's frames of another size, if `given` seems to be for these, by its focal
/// length and its principal point. Nothing if the kind has frames of the size of `given`.
std::optional<Intrinsics> OfAnotherSize(const std::string& sensor, const Intrinsics& given);

struct ImageSize {
  int width = 0;
  int height = 0;
};

/// Parses WIDTHxHEIGHT, 16 to 4096 px each. Throws ConfigError.
ImageSize ParseImageSize(const std::string& text);

/// May intrinsics be scaled to an image of this size? Aspect ratios have to agree within 2 %.
bool SameAspect(const Intrinsics& intrinsics, ImageSize size);

/// The colour camera beside a depth camera, by the device's calibration.
struct ColourCamera {
  /// p_colour = T p_depth, metres; both frames x right, y down, z forward.
  Pose colour_from_depth = Pose::Identity();
  std::optional<Intrinsics> intrinsics;  ///< of the colour pictures, if known
};

}  // namespace volalign
