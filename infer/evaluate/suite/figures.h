#pragma once

#include <filesystem>
#include <vector>

#include "core/base/image.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/evaluate/suite/run_suite.h"
#include "infer/evaluate/suite/suite_config.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// Points of an aligned cloud, structure frame, with their distances to the structure, m.
struct ErrorCloud {
  std::vector<Eigen::Vector3d> points;
  std::vector<double> distances;
};
/// Adds the points of the pixels with a label.
void AddToCloud(const SensorView& view, const LabelImage& labels, const Structure& structure,
                const Pose& structure_from_sensor, ErrorCloud* cloud);

/// The cloud seen level from the azimuth `phi_deg` (from +x towards +z), without perspective,
/// nearer points before others. Violet is 0 m, yellow 5 cm or more, black nothing.
RgbImage DrawCloud(const ErrorCloud& cloud, const Structure& structure, double phi_deg);

/// A network's attention over the shaded depth: violet is 0, yellow 1, dark without depth. Throws
/// Error on unequal sizes.
RgbImage DrawAttention(const DepthImage& depth, const Image<float>& attention);

/// Draws the suite's qualitative figures into figures/ of the run's folder: NAME.png, with a row
/// for each method whose model exists. Returns the files' paths. Throws as RunSuite.
std::vector<std::filesystem::path> WriteFigures(const SuiteConfig& suite, const SuiteRun& run);

}  // namespace volalign
