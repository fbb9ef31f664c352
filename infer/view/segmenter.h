#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "core/camera.h"
#include "core/image.h"
#include "core/structure.h"
#include "infer/view/segmentation.h"

namespace volalign {

/// A frame to segment. What it refers to must outlive the call.
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
/// labels that the network was trained on. It runs on `device` (core/torch_device.h). Threads of
/// LibTorch are the program's to set (core/torch_threads.h). Throws IoError, DataError, or
/// ConfigError for a device that is not there.
std::unique_ptr<NetworkSegmenter> LoadNetworkSegmenter(const std::filesystem::path& checkpoint,
                                                       const Structure* structure = nullptr,
                                                       const std::string& device = "cpu");

}  // namespace volalign
