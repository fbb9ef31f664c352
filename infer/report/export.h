#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "core/base/folder.h"
#include "core/geometry/structure.h"
#include "infer/calib/result.h"
#include "infer/report/extrinsics.h"
#include "infer/report/html_report/payload.h"
#include "infer/report/report.h"
#include "infer/view/sensor_frame.h"

namespace volalign {

/// Writes the draft of `folder` and publishes it, with the caller's files in it. Images are
/// labels/NAME.png (ids), confidence/NAME.png (255 = certain), pictures/NAME.png and
/// pictures/overview.png. Clouds are clouds/NAME.ply of placed sensors and clouds/merged.ply. Last
/// comes extrinsics.json, so that it names a complete folder. With `report`, report.html and
/// rig.glb are written too. Each of several captures has folders of its own in these
/// (labels/CAPTURE/NAME.png), and clouds are in the structure frame of the first. The third
/// argument has the captures of `result`. Files of sensors in an earlier extrinsics.json are
/// removed if this run does not write them; nothing else is. Throws IoError.
void WriteCalibration(const ResultFolder& folder, const CalibrationResult& result,
                      const std::vector<Capture>& captures, const Structure& structure,
                      const ExtrinsicsSource& source,
                      const std::optional<ReportRun>& report = std::nullopt);

/// Writes report.html alone, atomically. Throws IoError.
void WriteReportPage(const std::filesystem::path& path, const CalibrationResult& result,
                     const std::vector<Capture>& captures, const Structure& structure,
                     const ExtrinsicsSource& source, const ReportRun& run);

}  // namespace volalign
