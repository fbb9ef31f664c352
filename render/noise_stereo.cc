#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "core/base/noise_fields.h"
#include "render/noise_models.h"

namespace volalign {
namespace {

// The parameters of the model (docs/sensor-models.md has their sources). Lengths in px are for
// images 320 px wide and scale with the width. Growth of the foreground by the matching window.
constexpr double kFattenCorrelation = 6;  // px, of the wavy outline
constexpr float kForegroundStep = 0.05F;  // m, least depth step that counts as foreground
// Depth edges: some stretches lose a strip, and some others have mixed pixels.
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
// A pixel finds its match if the sum of these terms is positive.
constexpr double kCoarseCorrelation[2] = {40, 100}, kFineCorrelation[2] = {3, 10};  // px
constexpr float kCoarseWeight = 0.9F, kFineWeight = 0.4F;  // of the two random fields
constexpr double kQuality[2] = {-0.3, 1.0};          // of a frame, on everything but the structure
constexpr double kStructureQuality[2] = {2.3, 3.6};  // of a frame, on the structure (cardboard)
constexpr float kTextureGain = 2.2F, kMeanTexture = 0.45F;
constexpr float kDistanceLoss = 0.25F, kFullQualityDistance = 2.5F;  // per metre; m
constexpr float kGrazingLoss = 2.0F, kGrazingCosine = 0.35F;
constexpr float kSteepLoss = 8.0F, kSteepCosine = 0.22F;
constexpr double kOcclusionMargin = 0.5;  // px

/// The left view after matching.
struct MatchedView {
  NoisyView view;
  Image16 faces;  // as RenderedView's
};

/// For row v: `source[u]` is the index of the pixel that the window takes for u. It is offset by
/// `reach` (du, dv) and a dither in [0, 1) minus one half. `nearer[u]`: that pixel has depth, and u
/// has none or a depth that is larger by more than kForegroundStep.
VOLALIGN_CLONES void TakeForeground(const float* __restrict depth, int width, int height, int v,
                                    const float* __restrict du, const float* __restrict dv,
                                    const float* __restrict dither, float reach,
                                    std::int32_t* __restrict source,
                                    std::uint8_t* __restrict nearer) {
  for (int u = 0; u < width; ++u) {
    const float moved = dither[u] - 0.5F;
    const int p = u + static_cast<int>(std::nearbyint(reach * du[u] + moved));
    const int q = v + static_cast<int>(std::nearbyint(reach * dv[u] + moved));
    source[u] = std::min(std::max(q, 0), height - 1) * width + std::min(std::max(p, 0), width - 1);
  }
  const float* const row = depth + static_cast<std::ptrdiff_t>(v) * width;
  for (int u = 0; u < width; ++u) {
    const float here = row[u], there = depth[source[u]];
    nearer[u] = (there > 0) & ((here == 0) | (there < here - kForegroundStep));
  }
}

/// Grows the foreground by about a pixel, with a wavy outline. Labels follow the surface that gives
/// the depth. Draws the device's outlines if `known` is false.
MatchedView DilateForeground(const RenderedView& view, double scale, bool known,
                             RandomStream& random, StereoDevice* device) {
  const int width = view.depth.width(), height = view.depth.height();
  MatchedView out{{view.depth, view.labels}, view.faces};
  if (!known) {
    device->outline_u = SmoothField(width, height, kFattenCorrelation * scale, random);
    device->outline_v = SmoothField(width, height, kFattenCorrelation * scale, random);
  }
  const Image<float>&du = device->outline_u, &dv = device->outline_v;
  const PixelRandom pixel(random);
  const auto columns = static_cast<std::size_t>(width);
  std::vector<float> dither(columns);
  std::vector<std::int32_t> source(columns);
  std::vector<std::uint8_t> nearer(columns + 7);
  for (int v = 0; v < height; ++v) {
    const std::size_t first = static_cast<std::size_t>(v) * columns;
    pixel.Uniforms(first, width, dither.data());
    TakeForeground(view.depth.data(), width, height, v, &du[first], &dv[first], dither.data(),
                   static_cast<float>(scale), source.data(), nearer.data());
    ForEachSet(nearer, width, [&](int u) {
      const std::size_t i = first + static_cast<std::size_t>(u);
      const auto from = static_cast<std::size_t>(source[static_cast<std::size_t>(u)]);
      if (view.faces[from] == view.faces[i]) return;
      out.view.depth[i] = view.depth[from];
      out.view.labels[i] = view.labels[from];
      out.faces[i] = view.faces[from];
    });
  }
  return out;
}

/// Mixes both surfaces in some pixels at depth edges and clears strips along others, in addition to
/// half-occlusion.
void AddEdgeNoise(double scale, RandomStream& random, MatchedView* matched,
                  Image<std::uint8_t>* keep) {
  DepthImage& depth = matched->view.depth;
  LabelImage& labels = matched->view.labels;
  const Image16& faces = matched->faces;
  const int width = depth.width(), height = depth.height();
  const Image<float> edge_loss = SmoothField(width, height, kEdgeLossCorrelation * scale, random);
  const PixelRandom edge_dice(random);
  ForEachFaceEdge(faces, [&](int u, int v, int p, int q, std::uint64_t pair) {
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
/// Draws the device's part if `known` is false.
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
  pixel.Normals(0, static_cast<int>(error.size()), error.data());
  SmoothUnitNoise(kLocalSigmaU * scale, kLocalSigmaV * scale, &error);
  for (std::size_t i = 0; i < error.size(); ++i) {
    error[i] = static_cast<float>(device->local_sigma) * error[i] +
               static_cast<float>(device->warp_sigma) * warp[i];
  }
  return error;
}

/// Properties of a face for the matcher.
struct FaceInfo {
  float height;         // distance of the eye from the plane, m
  float confidence;     // before distance and incidence
  float distance_loss;  // of confidence, per metre
};

/// Does a pixel find its match? Texture has to outweigh distance, incidence and two random fields.
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

  std::vector<FaceInfo> OfFaces(const NoiseInput& input) const {
    const Eigen::Vector3d eye = input.structure_from_sensor.translation();
    std::vector<FaceInfo> infos;
    infos.reserve(input.mesh.faces.size());
    for (const SceneFace& face : input.mesh.faces) {
      const SceneObject& object = input.mesh.objects[static_cast<std::size_t>(face.object)];
      const auto height = static_cast<float>(face.normal.dot(eye) - face.offset);
      if (object.is_structure) {
        infos.push_back({height, structure_quality_, 0});
      } else {
        infos.push_back(
            {height, quality_ + kTextureGain * (object.texture - kMeanTexture), kDistanceLoss});
      }
    }
    return infos;
  }
  const Image<float>& coarse() const { return coarse_; }
  const Image<float>& fine() const { return fine_; }

 private:
  Image<float> coarse_, fine_;
  float quality_, structure_quality_;
};

/// A row of pixels. Faces, rays and the three numbers of a face are [count], rays as pairs (x, y).
struct MatchRow {
  int count;
  const std::uint16_t* faces;
  const float *rays, *height, *confidence, *distance_loss;  ///< the last three: see FaceInfo
  const float *coarse, *fine, *disparity_error;
  float image_fb, native_fb;  ///< focal length times baseline, px m: of this image, of the model's
  float largest_disparity;    ///< px of this image
  float margin;               ///< px
};

/// Adds the disparity's error to `depth`, and clears `keep` if no match is found. `scratch` has 3
/// `count` numbers.
VOLALIGN_CLONES void MatchOf(const MatchRow& row, float* __restrict depth,
                             std::uint8_t* __restrict keep, float* __restrict scratch) {
  constexpr float kInfinite = std::numeric_limits<float>::infinity();
  const int count = row.count;
  float* __restrict column = scratch;
  float* __restrict covered = scratch + count;
  float* __restrict seen = scratch + 2 * count;  // 1 if a match is found, apart from occlusion
  const std::uint16_t* __restrict faces = row.faces;
  const float* __restrict rays = row.rays, * __restrict height = row.height;
  const float* __restrict of_face = row.confidence, * __restrict loss = row.distance_loss;
  const float* __restrict coarse = row.coarse, * __restrict fine = row.fine;
  const float* __restrict disparity_error = row.disparity_error;
  const float image_fb = row.image_fb, native_fb = row.native_fb, largest = row.largest_disparity;
  for (int u = 0; u < count; ++u) {
    const float z = depth[u];
    const float x = rays[2 * u], y = rays[2 * u + 1];
    const float disparity = image_fb / z;
    const bool valid = (faces[u] != 0) & (z > 0);
    const float at = static_cast<float>(u) - disparity;
    column[u] = valid ? at : kInfinite;
    const float cosine = std::min(height[u] / (z * std::sqrt(x * x + y * y + 1)), 1.0F);
    const float far = std::max(z - kFullQualityDistance, 0.0F);
    const float confidence = of_face[u] - loss[u] * far -
                             kGrazingLoss * std::max(kGrazingCosine - cosine, 0.0F) -
                             kSteepLoss * std::max(kSteepCosine - cosine, 0.0F) +
                             kCoarseWeight * coarse[u] + kFineWeight * fine[u];
    const bool lost = (at < 0) | (confidence < 0) | (disparity > largest);
    const float measured =
        native_fb / std::max(native_fb / z + disparity_error[u], kLeastDisparity);
    seen[u] = (valid & !lost) ? 1.0F : 0.0F;
    depth[u] = (valid & !lost) ? measured : z;
  }
  // Column of the right image that a surface further right covers already: only the left camera
  // sees surfaces behind it.
  float beyond = kInfinite;
  for (int u = count - 1; u >= 0; --u) {
    covered[u] = beyond;
    beyond = std::min(beyond, column[u]);
  }
  for (int u = 0; u < count; ++u) {
    const bool found = (seen[u] > 0) & !(column[u] > covered[u] + row.margin);
    keep[u] = found ? keep[u] : std::uint8_t{0};
  }
}

/// Matches each pixel of the left image with the right one. Adds the disparity's error to the depth
/// and clears `keep` of pixels without a match.
void Match(const StereoModel& model, const NoiseInput& input, double scale,
           const MatchConfidence& confidence, const Image<float>& disparity_error,
           MatchedView* matched, Image<std::uint8_t>* keep) {
  DepthImage& depth = matched->view.depth;
  const int width = depth.width(), height = depth.height();
  const std::vector<FaceInfo> infos = confidence.OfFaces(input);
  const auto columns = static_cast<std::size_t>(width);
  std::vector<float> of_faces(3 * columns), scratch(3 * columns);
  MatchRow row{};
  row.count = width;
  row.height = of_faces.data();
  row.confidence = of_faces.data() + columns;
  row.distance_loss = of_faces.data() + 2 * columns;
  row.native_fb = static_cast<float>(model.focal_baseline);
  row.image_fb = static_cast<float>(model.focal_baseline * width / model.native_width);
  row.largest_disparity = static_cast<float>(model.largest_disparity * width / model.native_width);
  row.margin = static_cast<float>(kOcclusionMargin * scale);
  // The matcher cannot compare the first row.
  std::fill_n(keep->begin(), width, std::uint8_t{0});
  for (int v = 1; v < height; ++v) {
    const std::size_t first = static_cast<std::size_t>(v) * columns;
    row.faces = &matched->faces[first];
    row.rays = input.view.rays->rays[first].data();
    row.coarse = &confidence.coarse()[first];
    row.fine = &confidence.fine()[first];
    row.disparity_error = &disparity_error[first];
    ForEachRun(row.faces, width, [&](int begin, int end, std::size_t face) {
      const FaceInfo& info = infos[face];
      float* const to = of_faces.data() + begin;
      std::fill_n(to, end - begin, info.height);
      std::fill_n(to + columns, end - begin, info.confidence);
      std::fill_n(to + 2 * columns, end - begin, info.distance_loss);
    });
    MatchOf(row, &depth[first], &(*keep)[first], scratch.data());
  }
}

}  // namespace

NoisyView StereoNoise(const StereoModel& model, const NoiseInput& input, RandomStream& random,
                      std::optional<StereoDevice>* device) {
  const bool known = device->has_value();
  if (!known) device->emplace();
  const int width = input.view.depth.width(), height = input.view.depth.height();
  const double scale = width / kReferenceWidth;
  MatchedView matched = DilateForeground(input.view, scale, known, random, &**device);
  Image<std::uint8_t> keep(width, height, 1);
  AddEdgeNoise(scale, random, &matched, &keep);
  const Image<float> disparity_error =
      DisparityError(model, width, height, scale, known, random, &**device);
  const MatchConfidence confidence(width, height, scale, random);
  Match(model, input, scale, confidence, disparity_error, &matched, &keep);
  RoundKept(keep, &matched.view);
  return std::move(matched.view);
}

}  // namespace volalign
