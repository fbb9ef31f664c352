#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/camera.h"
#include "core/image.h"
#include "core/structure.h"

namespace volalign {

/// What a network sees in one frame, in the frame's own size and orientation.
struct SegmentationResult {
  LabelImage labels;        ///< 0 where there is no depth
  Image<float> confidence;  ///< probability of the label, 0 where there is no depth
};

/// A frame to segment; the referenced images must outlive the call.
struct SegmentationRequest {
  const DepthImage* depth = nullptr;
  const Intrinsics* intrinsics = nullptr;
  int quarter_turns = 0;  ///< clockwise turns into the network's orientation, 0-3
};

/// Labels depth maps with a structure's sides.
class Segmenter {
 public:
  virtual ~Segmenter() = default;

  /// One result a request, in order.
  virtual std::vector<SegmentationResult> Segment(
      const std::vector<SegmentationRequest>& requests) = 0;

  SegmentationResult Segment(const DepthImage& depth, const Intrinsics& intrinsics,
                             int quarter_turns) {
    return Segment({SegmentationRequest{&depth, &intrinsics, quarter_turns}}).front();
  }
};

/// The shipped network as a Segmenter.
class NetworkSegmenter : public Segmenter {
 public:
  using Segmenter::Segment;
  /// The structure that the network was trained on.
  virtual const Structure& structure() const = 0;
  virtual const std::string& file() const = 0;
  virtual const std::string& sha256() const = 0;  ///< of the checkpoint file
};

/// Loads a checkpoint (core/checkpoint.h). `structure`, where given, must have the topology and
/// labels that the network was trained on. Throws IoError or DataError.
std::unique_ptr<NetworkSegmenter> LoadNetworkSegmenter(const std::filesystem::path& checkpoint,
                                                       const Structure* structure = nullptr,
                                                       int num_threads = 2);

/// How a frame is presented to a network that knows focal lengths from focal_px.first to
/// focal_px.second only: both sides are divided by `scale`, by nearest neighbour; depths are never
/// averaged.
struct NetworkFrame {
  int width = 0, height = 0;  ///< before turning
  double scale = 1;           ///< frame pixels per network pixel
};

/// Chooses scale 1 for a focal length within the range (2 % beyond it is within), else the whole
/// number that brings it there, else the ratio to the range's geometric mean. Throws DataError for
/// a frame that would be smaller than 16 px.
NetworkFrame PlanNetworkFrame(const Intrinsics& intrinsics, std::pair<double, double> focal_px);

DepthImage ResampleDepth(const DepthImage& depth, const NetworkFrame& frame);

/// Labels and confidences of the network's frame back at full size. Every pixel with depth takes
/// the nearest network pixel, or, where that one looks at another surface (depths differ by over 3
/// cm), the one of its 8 neighbours whose depth is most alike. `small_depth` is what ResampleDepth
/// made.
SegmentationResult RestoreSegmentation(const DepthImage& depth, const DepthImage& small_depth,
                                       const LabelImage& small_labels,
                                       const Image<float>& small_confidence,
                                       const NetworkFrame& frame);

}  // namespace volalign
