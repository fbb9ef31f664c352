#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/geometry/structure.h"
#include "train/batch.h"

namespace volalign {

/// A recorded frame, and what a calibration says about it.
struct RealFrame {
  std::string name;  ///< its depth file
  std::string sensor;
  DepthImage depth;  ///< m, 0 where nothing was measured
  Intrinsics intrinsics;
  Pose structure_from_sensor = Pose::Identity();
  std::shared_ptr<const Structure> structure;  ///< as it was built there
};

/// The frames of sensors whose status is ok in these extrinsics.json (docs/formats.md), each of one
/// still, with verdict ok and of this structure; with several depth files of a sensor, each is a
/// frame. Depth files are looked for from the folder of the extrinsics.json, then from that of its
/// capture. Throws ConfigError for a calibration that is not so, IoError, DataError.
std::vector<RealFrame> ReadRealFrames(const std::vector<std::string>& extrinsics,
                                      const Structure& structure);

/// A depth map may lie so far from the structure, m, and be that of the side there: farther than
/// noise and a calibration's errors reach, and less than a person's hand before the boxes
/// (extrinsics.json calls 3 cm an inlier).
inline constexpr double kLabelReach = 0.03;

/// A frame as a training sample: turned to the mounting of the first of `roll_offsets_deg` with
/// which its image has the aspect ratio of width x height, and resampled to that size by nearest
/// neighbour; its labels are those that the structure has there. Where the structure is expected
/// and the depth is another, and where a neighbour's surface explains a depth beside the structure,
/// labels are not known: the pixel counts as without depth, which is background
/// (render/sample.h: Sample::labels). Null where no turn gives it that ratio.
std::unique_ptr<Sample> LabelledSample(const RealFrame& frame, int width, int height,
                                       const std::vector<double>& roll_offsets_deg);

/// Each batch of `inner` with a share of its samples replaced by labelled frames, which ones being
/// a function of seed and index.
std::unique_ptr<SampleSource> MixIn(std::unique_ptr<SampleSource> inner,
                                    std::shared_ptr<const std::vector<RealFrame>> frames,
                                    double share, std::uint64_t seed,
                                    const std::vector<double>& roll_offsets_deg);

/// The frames, in batches of one size of `image_sizes` each, again and again. Throws ConfigError
/// for a frame that fits none.
std::unique_ptr<SampleSource> HeldOut(const std::vector<RealFrame>& frames,
                                      const std::vector<std::pair<int, int>>& image_sizes,
                                      int batch_size, const std::vector<double>& roll_offsets_deg);

}  // namespace volalign
