#include "infer/segment_onnx/encode_depth.h"

#include <algorithm>

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

}  // namespace volalign
