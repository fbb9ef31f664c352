#pragma once

#include <vector>

#include "core/base/image.h"
#include "core/geometry/camera.h"
#include "infer/view/segmentation.h"

namespace volalign {

/// A frame to segment. The objects that it refers to must outlive the call.
struct SegmentationRequest {
  const DepthImage* depth = nullptr;
  const Intrinsics* intrinsics = nullptr;
  int quarter_turns = 0;  ///< clockwise turns into the network's orientation, 0-3
};

/// Labels depth maps with a structure's sides.
class Segmenter {
 public:
  virtual ~Segmenter() = default;

  /// One result for each request, in their order.
  virtual std::vector<SegmentationResult> Segment(
      const std::vector<SegmentationRequest>& requests) = 0;

  SegmentationResult Segment(const DepthImage& depth, const Intrinsics& intrinsics,
                             int quarter_turns) {
    return Segment({SegmentationRequest{&depth, &intrinsics, quarter_turns}}).front();
  }
};

}  // namespace volalign
