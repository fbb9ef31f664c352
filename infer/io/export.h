#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/image.h"
#include "core/structure.h"
#include "infer/calibrate.h"
#include "infer/io/extrinsics.h"

namespace volalign {

/// A point of an aligned cloud, structure frame.
struct ExportPoint {
  float x = 0, y = 0, z = 0;  ///< m
  Rgb colour;                 ///< of the label; grey for background
  std::uint8_t label = 0;
  float confidence = 0;
  float residual =
      0;  ///< m: to the side that the label names, or, for background, to the structure
};

/// Points of a placed sensor within `max_radius` m of the structure's vertical axis, depths
/// corrected by its offset.
std::vector<ExportPoint> AlignedPoints(const SensorFrame& frame, const SensorResult& result,
                                       const Structure& structure, double max_radius = 3.0);

/// Binary little-endian PLY: x y z red green blue label confidence residual. Atomic. Throws
/// IoError.
void WritePly(const std::filesystem::path& path, const std::vector<ExportPoint>& points);

/// Depth, predicted labels over depth and, for a placed sensor, the structure as seen from the
/// estimated pose, side by side, turned upright by `turns`.
RgbImage SensorPicture(const SensorFrame& frame, const SensorResult& result,
                       const Structure& structure, int turns);

/// Table of sensors (status, sides, RMS, standard deviations, errors where there is a ground
/// truth), reasons and hints of those that are not ok, the overlap of each two, d1 and d2, and a
/// verdict; for a terminal.
std::string FormatReport(const CalibrationResult& result);

/// Writes into `folder`: extrinsics.json (last, so that it names a complete folder),
/// labels/NAME.png (ids), confidence/NAME.png (255 = certain), pictures/NAME.png and
/// pictures/overview.png, clouds/NAME.ply of placed sensors and clouds/merged.ply. Throws IoError.
void WriteCalibration(const std::filesystem::path& folder, const CalibrationResult& result,
                      const std::vector<SensorFrame>& frames, const Structure& structure,
                      const ExtrinsicsSource& source);

}  // namespace volalign
