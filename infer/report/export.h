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

/// Writes the draft of `folder` and publishes it, with what the caller has put there:
/// extrinsics.json (last, so that it names a complete folder),
/// labels/NAME.png (ids), confidence/NAME.png (255 = certain), pictures/NAME.png and
/// pictures/overview.png, clouds/NAME.ply of placed sensors and clouds/merged.ply. Of several
/// stills, each has folders of its own in these (labels/STILL/NAME.png), and clouds are in the
/// structure frame of the first. `stills` are those that `result` is of. With `report`, report.html
/// and rig.glb, too. Of the sensors that an earlier extrinsics.json in the folder lists, the files
/// that this run does not write go; nothing else is removed. Throws IoError.
void WriteCalibration(const ResultFolder& folder, const CalibrationResult& result,
                      const std::vector<Still>& stills, const Structure& structure,
                      const ExtrinsicsSource& source,
                      const std::optional<ReportRun>& report = std::nullopt);

/// report.html alone. Writes atomically. Throws IoError.
void WriteReportPage(const std::filesystem::path& path, const CalibrationResult& result,
                     const std::vector<Still>& stills, const Structure& structure,
                     const ExtrinsicsSource& source, const ReportRun& run);

}  // namespace volalign
