#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "core/base/folder.h"
#include "core/geometry/structure.h"
#include "infer/calib/calibrate.h"
#include "infer/report/extrinsics.h"
#include "infer/report/html_report/payload.h"
#include "infer/report/report.h"
#include "infer/view/network_segmenter.h"

namespace volalign {

/// A calibration with all that its files are written from.
struct Calibration {
  std::vector<Capture> captures;
  Structure structure;  ///< as described
  CalibrationResult result;
  ExtrinsicsSource source;
  std::string options;  ///< all of them, YAML
};

/// Calibrate, with the origin of its result. `files`: of each capture. `network` may be null.
Calibration CalibrateFiles(std::vector<Capture> captures, std::vector<std::string> files,
                           const Structure& structure, NetworkSegmenter* network,
                           const CalibrateOptions& options, const CalibrateProgress& progress);

Extrinsics MakeExtrinsics(const Calibration& calibration);

/// Writes the draft of `folder` and publishes it, with the caller's files in it. The options are
/// options.yaml. Images are labels/NAME.png (ids), confidence/NAME.png (255 = certain),
/// pictures/NAME.png and pictures/overview.png. Clouds are clouds/NAME.ply of placed sensors and
/// clouds/merged.ply. Last comes extrinsics.json, so that it names a complete folder. With
/// `report`, report.html and rig.glb are written too. Each of several captures has folders of its
/// own in these (labels/CAPTURE/NAME.png), and clouds are in the structure frame of the first.
/// Files of sensors in an earlier extrinsics.json are removed if this run does not write them;
/// nothing else is. Throws IoError.
void WriteCalibration(const ResultFolder& folder, const Calibration& calibration,
                      const std::optional<ReportRun>& report = std::nullopt);

/// Writes report.html alone, atomically. Throws IoError.
void WriteReportPage(const std::filesystem::path& path, const Calibration& calibration,
                     const ReportRun& run);

}  // namespace volalign
