#pragma once

#include <string>
#include <utility>
#include <vector>

#include "core/base/image.h"
#include "core/geometry/structure.h"
#include "infer/view/segmentation.h"
#include "infer/view/segmenter.h"

namespace volalign {

/// The properties of a network that calibration needs, whatever runs it.
struct NetworkDescription {
  Structure structure;                       ///< that it was trained on
  std::pair<double, double> focal_px{0, 0};  ///< least and largest focal length in training, px
  std::string file;
  std::string sha256;   ///< of the file
  std::string runtime;  ///< the program that runs it: "LibTorch 1.13.1"
};

/// A trained network as a Segmenter. Brings frames to the size and orientation of its training, and
/// its labels back (network_frame.h). Each runtime derives a class from it.
class NetworkSegmenter : public Segmenter {
 public:
  using Segmenter::Segment;
  /// Throws DataError for a frame that is too small, and what Forward throws.
  std::vector<SegmentationResult> Segment(
      const std::vector<SegmentationRequest>& requests) override;

  const Structure& structure() const { return description_.structure; }
  const std::string& file() const { return description_.file; }
  const std::string& sha256() const { return description_.sha256; }
  const std::string& runtime() const { return description_.runtime; }

 protected:
  explicit NetworkSegmenter(NetworkDescription description);

  /// Labels and confidences of 1 to 8 depth maps of one size in the network's orientation, in
  /// metres, 0 without depth. Every pixel has a label, also without depth.
  virtual std::vector<SegmentationResult> Forward(const std::vector<const DepthImage*>& depths) = 0;

 private:
  const NetworkDescription description_;
};

}  // namespace volalign
