#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/geometry/structure.h"
#include "train/batch.h"

namespace volalign {

/// A recorded frame with its calibration.
struct RealFrame {
  std::string name;  ///< its depth file
  std::string sensor;
  DepthImage depth;  ///< m, 0 where nothing was measured
  Intrinsics intrinsics;
  Pose structure_from_sensor = Pose::Identity();
  std::shared_ptr<const Structure> structure;  ///< as it was built there
};

/// The frames of sensors with status ok in these extrinsics.json (docs/formats.md). Each file has
/// to be of one capture, with verdict ok and of this structure. Each of several depth files of a
/// sensor is a frame. Depth files are looked for from the folder of the extrinsics.json, then from
/// that of its capture. Throws ConfigError for another calibration, IoError, DataError.
std::vector<RealFrame> ReadRealFrames(const std::vector<std::string>& extrinsics,
                                      const Structure& structure);

/// Largest distance, m, of a depth from the structure at which it belongs to the side there. It is
/// more than noise and a calibration's errors, and less than the distance of a person's hand before
/// the boxes. extrinsics.json calls 3 cm an inlier.
inline constexpr double kLabelReach = 0.03;

/// A frame as a training sample. It is turned to the mounting of the first of `roll_offsets_deg` at
/// which its image has the aspect ratio of width x height. It is resampled to that size by nearest
/// neighbour. Labels are those of the structure at each pixel. A label is unknown if the depth
/// differs from the structure expected there, or if a neighbour's surface explains a depth beside
/// the structure. The pixel then counts as without depth, which is background (render/sample.h:
/// Sample::labels). Null if no turn gives that ratio.
std::unique_ptr<Sample> LabelledSample(const RealFrame& frame, int width, int height,
                                       const std::vector<double>& roll_offsets_deg);

/// Each batch of `inner` with a share of its samples replaced by labelled frames. The choice is a
/// function of seed and index.
SampleSource MixRecordedFrames(SampleSource inner,
                               std::shared_ptr<const std::vector<RealFrame>> frames, double share,
                               std::uint64_t seed, const std::vector<double>& roll_offsets_deg);

/// The frames in batches of one size of `image_sizes` each, again and again. Throws ConfigError for
/// a frame that fits no size.
SampleSource ValidationFrames(const std::vector<RealFrame>& frames,
                              const std::vector<std::pair<int, int>>& image_sizes, int batch_size,
                              const std::vector<double>& roll_offsets_deg);

}  // namespace volalign
