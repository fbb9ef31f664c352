#pragma once

#include <filesystem>
#include <vector>

#include "core/structure.h"
#include "infer/calibrate.h"
#include "infer/io/extrinsics.h"
#include "infer/io/report.h"
#include "infer/view/sensor_frame.h"

namespace volalign {

/// Writes into `folder`: extrinsics.json (last, so that it names a complete folder),
/// labels/NAME.png (ids), confidence/NAME.png (255 = certain), pictures/NAME.png and
/// pictures/overview.png, clouds/NAME.ply of placed sensors and clouds/merged.ply. `frames` are
/// those that `result` is of. Throws IoError.
void WriteCalibration(const std::filesystem::path& folder, const CalibrationResult& result,
                      const std::vector<SensorFrame>& frames, const Structure& structure,
                      const ExtrinsicsSource& source);

}  // namespace volalign
