#include <algorithm>
#include <cmath>
#include <vector>

#include "core/base/noise_fields.h"
#include "render/noise_models.h"

namespace volalign {
namespace {

// The figures of the model (docs/sensor-models.md has their sources). Lengths in px are for images
// 320 px wide and scale with the width.
constexpr double kReferenceWidth = 320;
// Foreground as the matching window grows it.
constexpr double kFattenCorrelation = 6;  // px, of the wavy outline
constexpr float kForegroundStep = 0.05F;  // m, least depth step that counts as foreground
// Depth edges: a stretch of them loses a strip, some of the others have mixed pixels.
constexpr float kEdgeStep = 0.06F;                // m, least depth step of an edge
constexpr double kEdgeLossCorrelation = 15;       // px
constexpr float kEdgeLossThreshold = 0.75F;       // of a unit normal field
constexpr double kWidestEdgeLoss = 2.5;           // px
constexpr float kMixedShare = 0.10F;              // of the other jumps along rows
constexpr float kMixLow = 0.2F, kMixHigh = 0.8F;  // weights of the first pixel in a mixed one
// Disparity error.
constexpr double kWarpCorrelation[2] = {10, 40};          // px
constexpr double kLocalSigmaU = 1.2, kLocalSigmaV = 0.9;  // px, smoothing of the local noise
constexpr float kLeastDisparity = 0.5F;                   // px, after the error
// Whether a pixel finds its match: the sum of these terms has to be positive.
constexpr double kCoarseCorrelation[2] = {40, 100}, kFineCorrelation[2] = {3, 10};  // px
constexpr float kCoarseWeight = 0.9F, kFineWeight = 0.4F;  // of the two random fields
constexpr double kQuality[2] = {-0.3, 1.0};          // of a frame, on everything but the structure
constexpr double kStructureQuality[2] = {2.3, 3.6};  // of a frame, on the structure (cardboard)
constexpr float kTextureGain = 2.2F, kMeanTexture = 0.45F;
constexpr float kDistanceLoss = 0.25F, kFullQualityDistance = 2.5F;  // a metre; m
constexpr float kGrazingLoss = 2.0F, kGrazingCosine = 0.35F;
constexpr float kSteepLoss = 8.0F, kSteepCosine = 0.22F;
constexpr double kOcclusionMargin = 0.5;  // px

/// What the left camera's matcher takes a pixel for.
struct MatchedView {
  NoisyView view;
  Image16 faces;  // as RenderedView's
};

/// What the matcher sees: foreground grown by about a pixel, wavily. Labels follow the surface
/// whose depth is taken. Draws the device's outlines where `known` is false.
MatchedView Fatten(const RenderedView& view, double scale, bool known, RandomStream& random,
                   StereoDevice* device) {
  const int width = view.depth.width(), height = view.depth.height();
  MatchedView out{{DepthImage(width, height), LabelImage(width, height)}, Image16(width, height)};
  if (!known) {
    device->outline_u = SmoothField(width, height, kFattenCorrelation * scale, random);
    device->outline_v = SmoothField(width, height, kFattenCorrelation * scale, random);
  }
  const Image<float>&du = device->outline_u, &dv = device->outline_v;
  const PixelRandom pixel(random);
  std::size_t i = 0;
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u, ++i) {
      const auto reach = static_cast<float>(scale);
      const float dither = pixel.Uniform(i) - 0.5F;
      const int p =
          std::clamp(u + static_cast<int>(std::nearbyint(reach * du[i] + dither)), 0, width - 1);
      const int q =
          std::clamp(v + static_cast<int>(std::nearbyint(reach * dv[i] + dither)), 0, height - 1);
      const float here = view.depth[i], there = view.depth(p, q);
      const bool take = there > 0 && (here == 0 || there < here - kForegroundStep) &&
                        view.faces(p, q) != view.faces[i];
      out.view.depth[i] = take ? there : here;
      out.view.labels[i] = take ? view.labels(p, q) : view.labels[i];
      out.faces[i] = take ? view.faces(p, q) : view.faces[i];
    }
  }
  return out;
}

/// Mixes both surfaces in some pixels at depth edges and clears strips along others, besides what
/// half-occlusion takes.
void SpoilEdges(double scale, RandomStream& random, MatchedView* matched,
                Image<std::uint8_t>* keep) {
  DepthImage& depth = matched->view.depth;
  LabelImage& labels = matched->view.labels;
  const Image16& faces = matched->faces;
  const int width = depth.width(), height = depth.height();
  const Image<float> edge_loss = SmoothField(width, height, kEdgeLossCorrelation * scale, random);
  const PixelRandom edge_dice(random);
  ForEachNeighbourPair(width, height, [&](int u, int v, int p, int q, std::uint64_t pair) {
    if (faces(u, v) == faces(p, q)) return;
    const float a = depth(u, v), b = depth(p, q);
    if (a == 0 || b == 0 || std::abs(a - b) < kEdgeStep) return;
    const int far_u = a > b ? u : p, far_v = a > b ? v : q;
    const float dice = edge_dice.Uniform(pair);
    const float loss = edge_loss(u, v) - kEdgeLossThreshold;
    if (loss > 0) {
      const double r = scale * std::min(0.5 + 2.0 * loss, kWidestEdgeLoss) - 0.4 + 0.4 * dice;
      if (r > 0) ClearDisc(far_u, far_v, r, keep);
    } else if (dice < kMixedShare && v == q) {
      const float w = kMixLow + (kMixHigh - kMixLow) * (dice / kMixedShare);
      depth(far_u, far_v) = w * a + (1 - w) * b;
      labels(far_u, far_v) = 0;
    }
  });
}

/// Error of the disparity at the model's native resolution, px: local noise and a smooth warp.
/// Draws the device's part where `known` is false.
Image<float> DisparityError(const StereoModel& model, int width, int height, double scale,
                            bool known, RandomStream& random, StereoDevice* device) {
  if (!known) {
    device->local_sigma = random.Uniform(model.local_sigma[0], model.local_sigma[1]);
    device->warp_sigma = random.Uniform(model.warp_sigma[0], model.warp_sigma[1]);
    device->warp = SmoothField(
        width, height, scale * random.Uniform(kWarpCorrelation[0], kWarpCorrelation[1]), random);
  }
  const Image<float>& warp = device->warp;
  const PixelRandom pixel(random);
  Image<float> error(width, height);
  for (std::size_t i = 0; i < error.size(); ++i) error[i] = pixel.Normal(i);
  SmoothUnitNoise(kLocalSigmaU * scale, kLocalSigmaV * scale, &error);
  for (std::size_t i = 0; i < error.size(); ++i) {
    error[i] = static_cast<float>(device->local_sigma) * error[i] +
               static_cast<float>(device->warp_sigma) * warp[i];
  }
  return error;
}

/// Of a face, what the matcher depends on.
struct FaceInfo {
  float height;  // distance of the eye from the plane, m
  float texture;
  bool is_structure;
};

std::vector<FaceInfo> FaceInfos(const NoiseInput& input) {
  const Eigen::Vector3d eye = input.structure_from_sensor.translation();
  std::vector<FaceInfo> infos(input.mesh.faces.size());
  for (std::size_t i = 0; i < infos.size(); ++i) {
    const SceneFace& face = input.mesh.faces[i];
    const SceneObject& object = input.mesh.objects[static_cast<std::size_t>(face.object)];
    infos[i] = {static_cast<float>(face.normal.dot(eye) - face.offset), object.texture,
                object.is_structure};
  }
  return infos;
}

/// Whether a pixel finds its match: texture has to outweigh distance, incidence and two random
/// fields.
class MatchConfidence {
 public:
  MatchConfidence(int width, int height, double scale, RandomStream& random)
      : coarse_(SmoothField(width, height,
                            scale * random.Uniform(kCoarseCorrelation[0], kCoarseCorrelation[1]),
                            random)),
        fine_(SmoothField(width, height,
                          scale * random.Uniform(kFineCorrelation[0], kFineCorrelation[1]),
                          random)),
        quality_(static_cast<float>(random.Uniform(kQuality[0], kQuality[1]))),
        structure_quality_(
            static_cast<float>(random.Uniform(kStructureQuality[0], kStructureQuality[1]))) {}

  /// Of the pixel with index i that shows `face` at depth z, m; negative: no match.
  float At(std::size_t i, const FaceInfo& face, float z, float cosine) const {
    const float offset = face.is_structure
                             ? structure_quality_
                             : quality_ + kTextureGain * (face.texture - kMeanTexture) -
                                   kDistanceLoss * std::max(z - kFullQualityDistance, 0.0F);
    return offset - kGrazingLoss * std::max(kGrazingCosine - cosine, 0.0F) -
           kSteepLoss * std::max(kSteepCosine - cosine, 0.0F) + kCoarseWeight * coarse_[i] +
           kFineWeight * fine_[i];
  }

 private:
  Image<float> coarse_, fine_;
  float quality_, structure_quality_;
};

/// Matches each pixel of the left image with the right one: adds the disparity's error to the
/// depth and clears in `keep` what finds no match.
void Match(const StereoModel& model, const NoiseInput& input, double scale,
           const MatchConfidence& confidence, const Image<float>& disparity_error,
           MatchedView* matched, Image<std::uint8_t>* keep) {
  DepthImage& depth = matched->view.depth;
  const int width = depth.width(), height = depth.height();
  const std::vector<FaceInfo> infos = FaceInfos(input);
  const auto native_fb = static_cast<float>(model.focal_baseline);
  const auto image_fb =
      static_cast<float>(model.focal_baseline * width / model.native_width);  // px of this image
  const auto largest_disparity =
      static_cast<float>(model.largest_disparity * width / model.native_width);
  const auto margin = static_cast<float>(kOcclusionMargin * scale);
  for (int v = 0; v < height; ++v) {
    // Column of the right image that a surface further right covers already: what lies behind it is
    // seen by the left camera alone.
    float covered = 1e9F;
    for (int u = width - 1; u >= 0; --u) {
      const std::size_t i = static_cast<std::size_t>(v) * static_cast<std::size_t>(width) +
                            static_cast<std::size_t>(u);
      const float z = depth[i];
      if (matched->faces[i] == 0 || z <= 0) {
        (*keep)[i] = 0;
        continue;
      }
      const FaceInfo& face = infos[matched->faces[i] - 1U];
      const float x = input.view.rays->rays[i].x(), y = input.view.rays->rays[i].y();
      const float disparity = image_fb / z;
      const float column = static_cast<float>(u) - disparity;
      const bool occluded = column > covered + margin;
      covered = std::min(covered, column);
      const float cosine = std::min(face.height / (z * std::sqrt(x * x + y * y + 1)), 1.0F);
      if (occluded || column < 0 || confidence.At(i, face, z, cosine) < 0 ||
          disparity > largest_disparity || v == 0) {
        (*keep)[i] = 0;
        continue;
      }
      depth[i] = native_fb / std::max(native_fb / z + disparity_error[i], kLeastDisparity);
    }
  }
}

}  // namespace

NoisyView StereoNoise(const StereoModel& model, const NoiseInput& input, RandomStream& random,
                      std::optional<StereoDevice>* device) {
  const bool known = device->has_value();
  if (!known) device->emplace();
  const int width = input.view.depth.width(), height = input.view.depth.height();
  const double scale = width / kReferenceWidth;
  MatchedView matched = Fatten(input.view, scale, known, random, &**device);
  Image<std::uint8_t> keep(width, height, 1);
  SpoilEdges(scale, random, &matched, &keep);
  const Image<float> disparity_error =
      DisparityError(model, width, height, scale, known, random, &**device);
  const MatchConfidence confidence(width, height, scale, random);
  Match(model, input, scale, confidence, disparity_error, &matched, &keep);
  RoundKept(keep, &matched.view);
  return std::move(matched.view);
}

}  // namespace volalign
