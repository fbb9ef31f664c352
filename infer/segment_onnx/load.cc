#include "infer/segment_onnx/load.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <list>
#include <mutex>
#include <opencv2/dnn.hpp>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/input_file.h"
#include "infer/segment_onnx/onnx_network.h"

namespace volalign {

std::vector<float> EncodeDepth(const DepthImage& depth, InputEncoding input) {
  std::vector<float> planes(depth.begin(), depth.end());
  if (input == InputEncoding::kDepth) return planes;
  planes.resize(2 * depth.size());
  for (std::size_t i = 0; i < depth.size(); ++i) {
    const float mask = depth[i] > 0 ? 1.0f : 0.0f;
    planes[i] =
        (std::min(depth[i], static_cast<float>(kDepthClamp)) - static_cast<float>(kDepthCentre)) *
        mask;
    planes[depth.size() + i] = mask;
  }
  return planes;
}

namespace {

/// Most networks that are kept, each for one size of frames and with weights of its own: two kinds
/// of sensors, each in both orientations.
constexpr std::size_t kMostNets = 4;

/// The most probable class of each pixel of log-probabilities [K,H,W], and its probability.
SegmentationResult MostProbable(const float* log_probabilities, int classes, int width,
                                int height) {
  SegmentationResult result{LabelImage(width, height), Image<float>(width, height)};
  Image<float>& best = result.confidence;
  std::copy_n(log_probabilities, best.size(), best.begin());
  for (int k = 1; k < classes; ++k) {
    const float* const plane = log_probabilities + static_cast<std::size_t>(k) * best.size();
    for (std::size_t i = 0; i < best.size(); ++i) {
      if (!(plane[i] > best[i])) continue;
      best[i] = plane[i];
      result.labels[i] = static_cast<std::uint8_t>(k);
    }
  }
  for (float& value : best) value = std::exp(value);
  return result;
}

class OnnxSegmenter : public NetworkSegmenter {
 public:
  OnnxSegmenter(OnnxNetwork network, NetworkDescription description)
      : NetworkSegmenter(std::move(description)), network_(std::move(network)) {}

 private:
  struct SizedNet {
    int width, height;
    cv::dnn::Net net;
  };

  std::vector<SegmentationResult> Forward(const std::vector<const DepthImage*>& depths) override;

  /// OpenCV 4.6 has no dynamic sizes: the frame's is written into the graph.
  cv::dnn::Net& NetFor(int width, int height);

  std::mutex mutex_;  ///< there is one forward pass at a time
  OnnxNetwork network_;
  std::list<SizedNet> nets_;  ///< the last used one first
};

cv::dnn::Net& OnnxSegmenter::NetFor(int width, int height) {
  const auto known = std::find_if(nets_.begin(), nets_.end(), [&](const SizedNet& net) {
    return net.width == width && net.height == height;
  });
  if (known != nets_.end()) {
    nets_.splice(nets_.begin(), nets_, known);
    return nets_.front().net;
  }
  onnx::TensorShapeProto* shape = network_.model.mutable_graph()
                                      ->mutable_input(0)
                                      ->mutable_type()
                                      ->mutable_tensor_type()
                                      ->mutable_shape();
  shape->mutable_dim(0)->set_dim_value(1);
  shape->mutable_dim(2)->set_dim_value(height);
  shape->mutable_dim(3)->set_dim_value(width);
  const std::string bytes = network_.model.SerializeAsString();
  if (nets_.size() == kMostNets) nets_.pop_back();
  nets_.push_front({width, height, cv::dnn::readNetFromONNX(bytes.data(), bytes.size())});
  return nets_.front().net;
}

std::vector<SegmentationResult> OnnxSegmenter::Forward(
    const std::vector<const DepthImage*>& depths) {
  const StructureNetOptions& options = network_.meta.network;
  const int width = depths.front()->width(), height = depths.front()->height();
  std::vector<SegmentationResult> results;
  results.reserve(depths.size());
  const std::lock_guard<std::mutex> lock(mutex_);
  try {
    cv::dnn::Net& net = NetFor(width, height);
    for (const DepthImage* depth : depths) {
      std::vector<float> planes = EncodeDepth(*depth, options.input);
      const int sizes[] = {1, EncodedChannels(options.input), height, width};
      net.setInput(cv::Mat(4, sizes, CV_32F, planes.data()));
      const cv::Mat log_probabilities = net.forward();
      const int expected[] = {1, options.num_classes, height, width};
      if (log_probabilities.dims != 4 || log_probabilities.type() != CV_32F ||
          !std::equal(expected, expected + 4, log_probabilities.size.p)) {
        throw Error(fmt::format("{}: {} gives log-probabilities of another shape than {}x{}x{}",
                                file(), runtime(), options.num_classes, height, width));
      }
      results.push_back(
          MostProbable(log_probabilities.ptr<float>(), options.num_classes, width, height));
    }
  } catch (const cv::Exception& error) {
    throw Error(fmt::format("{}: OpenCV cannot run it on {}x{} pixels: {}", file(), width, height,
                            error.err));
  }
  return results;
}

}  // namespace

std::unique_ptr<NetworkSegmenter> LoadOnnxSegmenter(const std::filesystem::path& file,
                                                    const Structure* structure) {
  const std::string bytes = ReadFile(FindInputFile(file.string()), kMaxOnnxBytes);
  OnnxNetwork network;
  try {
    network = ReadOnnxNetwork(bytes);
  } catch (const DataError& error) {
    throw DataError(fmt::format("{}: not a whole ONNX file of volalign export ({})", file.string(),
                                error.what()));
  }
  const CheckpointMeta& meta = network.meta;
  if (structure) CheckStructure(meta, *structure);
  NetworkDescription description = {meta.structure, meta.focal_px, file.string(), Sha256(bytes),
                                    "OpenCV " CV_VERSION};
  return std::make_unique<OnnxSegmenter>(std::move(network), std::move(description));
}

}  // namespace volalign
