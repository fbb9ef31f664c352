#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "core/base/noise_fields.h"
#include "render/noise_models.h"

namespace volalign {
namespace {

// The parameters of the model (docs/sensor-models.md has their sources). Lengths in px are for
// images 320 px wide and scale with the width. A pair is the range of one number per frame.
constexpr double kTofWidth = 320, kTofHeight = 288;
// Depth error.
constexpr double kBias[2] = {-0.011, 0.011};                         // m
constexpr double kWhiteGain[2] = {0.75, 1.25};                       // of the white noise
constexpr float kWhiteNoise = 0.00012F, kWhiteNoiseSlope = 0.0001F;  // m, m per metre
constexpr double kGrainSigma = 0.62;                                 // px, its smoothing
constexpr float kLeastNoiseCosine = 0.15F;  // white noise grows no further at steeper incidence
constexpr double kWarpRms[2] = {0.0014, 0.0056};  // m
constexpr double kShortestWarp = 12;              // px of correlation
constexpr double kWarpRatio = 5.0;                // of the longest to the shortest
constexpr double kMultipath[2] = {0, 0.025};      // m, too far at a concave seam
constexpr double kFill[2] = {0, 0.02};            // m, too near in the corner itself
constexpr float kMultipathReach = 0.3F;           // m from the seam
constexpr float kFillReach = 0.06F;  // m, of the spatial filter that rounds concave corners
constexpr double kSeamRise = 0.02;   // m: least rise of a box in front of a face
constexpr float kSeamLevel = 0.99F;  // cosine: a side of a mesh is parallel to the floor
// Weak returns.
constexpr double kAmplitudeThreshold[2] = {0.001, 0.004};  // reflectivity cos / m^2, log-uniform
constexpr double kPatchCorrelation[2] = {10, 30};          // px
constexpr double kPatchLimit[2] = {1.2, 2.1};              // of a unit normal field, beyond: lost
constexpr float kStructurePatchLimit = 1.3F;               // higher on the structure
constexpr float kPatchWave = 0.125F;  // of the threshold; its 4th power is close to exp(patch / 2)
constexpr float kFarthest = 16.0F;    // m
constexpr double kSpeckles = 25.0, kSpeckleGain[2] = {0.2, 2.0};  // mean number per frame
constexpr double kSpeckleRadius[2] = {0.7, 3};                    // px
// Depth edges.
constexpr double kEdgeCorrelation = 25;                  // px along which gaps are alike
constexpr float kLeastJump = 0.08F, kJumpRange = 0.22F;  // m; gaps are full from 0.3 m on
constexpr float kGapDistance = 3.0F;  // m, far depth at which gaps are as stated; they grow with it
constexpr float kLeastGapGain = 0.5F, kMostGapGain = 1.2F;
constexpr float kFlyingShare = 0.09F;  // of the edges without a gap: 3 % of all edges
constexpr float kMixedJump = 0.3F;     // m, least jump of mixed pixels that the vendor detects
constexpr float kMixedLow = 0.15F, kMixedHigh = 0.85F;  // its depth between the neighbours'
constexpr float kMixedDetected = 0.7F;                  // share of them that is dropped
// Azure Kinect's illumination: |u - u0| <= half width - slope |v - v0| at 320x288.
constexpr double kHexagonCentreU[2] = {158, 170}, kHexagonCentreV = 147.6;
constexpr double kHexagonHalfWidth = 175.2, kHexagonSlopeAbove = 0.557, kHexagonSlopeBelow = 0.600;

/// Properties of a face that every pixel needs.
struct TofFace {
  float height = 0;        // distance of the eye from the plane, m
  float reflectivity = 0;  // 0..1
  bool is_structure = false;
  bool meets_floor = false;  // an upright side of the structure
  int seams = -1;            // index into Seams::rising; -1: none
};

/// A box of the structure, or the rectangle around a flat side of a mesh, in its own frame, to find
/// the concave seams near a point.
struct SeamBox {
  Eigen::Matrix<float, 3, 3, Eigen::RowMajor> rotation;  ///< box_from_structure
  Eigen::Vector3f centre;                                ///< in the structure's frame, m
  Eigen::Vector3f half;                                  ///< half its size, m
  Eigen::Vector3f lights;                                ///< a rectangle's normal; zero: a box

  /// Extent of the box along n from the origin, m.
  float Support(const Eigen::Vector3f& n) const {
    return n.dot(centre) + (rotation * n).cwiseAbs().dot(half);
  }
};

/// What rises in front of the sides of the structure: light from there makes a concave seam. Curved
/// and small surfaces of meshes neither give nor take such light.
struct Seams {
  std::vector<SeamBox> boxes;
  std::vector<std::vector<std::uint16_t>> rising;  // indices of boxes; of the sides, then the floor
};

/// Width in px (at 320) of the run of lost pixels at a depth edge. `q` is its quantile: 0 px 33 %,
/// 1 px 16 %, 2 px 19 %, 3 px 11 %, 4 to 12 px 21 %.
float GapWidth(float q) {
  if (q < 0.33F) return 0;
  if (q < 0.49F) return 1;
  if (q < 0.68F) return 2;
  if (q < 0.79F) return 3;
  const float t = (q - 0.79F) / 0.21F;
  return 4 + 8 * t * t * t;
}

float NormalCdf(float x) { return 0.5F * std::erfc(-0.70710678F * x); }

SeamBox SeamBoxOf(const Side& side) {
  SeamBox box;
  box.rotation.row(0) = side.axis_u.cast<float>();
  box.rotation.row(1) = side.axis_v.cast<float>();
  box.rotation.row(2) = side.normal.cast<float>();
  box.centre = side.centre.cast<float>();
  box.half = Eigen::Vector3d(side.half_u, side.half_v, 0).cast<float>();
  box.lights = side.normal.cast<float>();
  return box;
}

/// The boxes that rise in front of a plane. Of the rectangles, those that see `taker`, if it is
/// given, or are not level.
std::vector<std::uint16_t> Rising(const std::vector<SeamBox>& boxes, const Eigen::Vector3f& normal,
                                  double offset, const SeamBox* taker) {
  std::vector<std::uint16_t> rising;
  for (std::size_t b = 0; b < boxes.size(); ++b) {
    const SeamBox& box = boxes[b];
    if (!(box.Support(normal) > offset + kSeamRise)) continue;
    if (!box.lights.isZero()) {
      const bool sees = taker ? taker->Support(box.lights) > box.lights.dot(box.centre) + kSeamRise
                              : box.lights.dot(normal) < kSeamLevel;
      if (!sees) continue;
    }
    rising.push_back(static_cast<std::uint16_t>(b));
  }
  return rising;
}

Seams SeamsOf(const NoiseInput& input) {
  const std::vector<Side>& sides = input.structure.sides();
  Seams seams;
  seams.rising.resize(sides.size() + 1);
  const bool present = std::any_of(input.mesh.objects.begin(), input.mesh.objects.end(),
                                   [](const SceneObject& o) { return o.is_structure; });
  if (!present) return seams;
  std::vector<bool> takes;
  for (const Side& side : sides) {
    const Box& box = input.structure.boxes()[static_cast<std::size_t>(side.box)];
    takes.push_back(!box.mesh || box.mesh->facets()[static_cast<std::size_t>(side.index)].flat);
    if (box.mesh && takes.back()) seams.boxes.push_back(SeamBoxOf(side));
    if (box.mesh || side.index > 0) continue;
    seams.boxes.push_back({box.structure_from_box.linear().transpose().cast<float>(),
                           box.structure_from_box.translation().cast<float>(),
                           (0.5 * box.size).cast<float>(), Eigen::Vector3f::Zero()});
  }
  for (std::size_t i = 0; i < sides.size(); ++i) {
    const SeamBox taker = SeamBoxOf(sides[i]);
    if (takes[i])
      seams.rising[i] =
          Rising(seams.boxes, taker.lights, sides[i].normal.dot(sides[i].centre), &taker);
  }
  seams.rising.back() =
      Rising(seams.boxes, Eigen::Vector3f::UnitY(), input.structure.FloorHeight(), nullptr);
  return seams;
}

std::vector<TofFace> TofFaces(const NoiseInput& input, const Seams& seams) {
  const Eigen::Vector3d eye = input.structure_from_sensor.translation();
  const double floor = input.structure.FloorHeight();
  std::vector<TofFace> infos(input.mesh.faces.size());
  for (std::size_t i = 0; i < infos.size(); ++i) {
    const SceneFace& face = input.mesh.faces[i];
    const SceneObject& object = input.mesh.objects[static_cast<std::size_t>(face.object)];
    infos[i].height = static_cast<float>(face.normal.dot(eye) - face.offset);
    infos[i].reflectivity = object.reflectivity;
    infos[i].is_structure = object.is_structure;
    const bool is_floor =
        !object.is_structure && face.normal.y() > 0.99 && std::abs(face.offset - floor) < 2e-3;
    if (infos[i].height <= 0 || !(object.is_structure || is_floor)) continue;
    infos[i].meets_floor = object.is_structure && std::abs(face.normal.y()) < 0.5;
    infos[i].seams = object.is_structure ? face.side : static_cast<int>(seams.rising.size()) - 1;
  }
  return infos;
}

/// Makes gaps along depth edges, and flying pixels where there is no gap.
void AddEdgeNoise(const RenderedView& clean, double scale, RandomStream& random, NoisyView* noisy,
                  Image<std::uint8_t>* keep) {
  const int width = clean.depth.width(), height = clean.depth.height();
  const Image<float> coherence = SmoothField(width, height, kEdgeCorrelation * scale, random);
  const PixelRandom pixel(random);
  ForEachFaceEdge(clean.faces, [&](int u, int v, int p, int q, std::uint64_t pair) {
    const float a = clean.depth(u, v), b = clean.depth(p, q);
    const float jump = std::abs(a - b);
    if (a == 0 || b == 0 || jump < kLeastJump) return;
    const float share = std::min((jump - kLeastJump) / kJumpRange, 1.0F);
    const float far = std::clamp(std::max(a, b) / kGapDistance, kLeastGapGain, kMostGapGain);
    const float quantile = NormalCdf(0.95F * coherence(u, v) + 0.31F * pixel.Normal(2 * pair));
    const float gap = GapWidth(quantile) * share * far * static_cast<float>(scale);
    const float dice = pixel.Uniform(2 * pair + 1);
    const int count = static_cast<int>(gap + dice);
    const bool first_is_far = a > b;
    const int far_u = first_is_far ? u : p, far_v = first_is_far ? v : q;
    if (count == 0) {
      if (dice < kFlyingShare) {
        noisy->depth(far_u, far_v) = std::min(a, b) + jump * (0.2F + 0.6F * (dice / kFlyingShare));
        noisy->labels(far_u, far_v) = 0;
      }
      return;
    }
    const double toward_near = count % 2 == 0 ? 0.5 : 0.0;
    const double sign = first_is_far ? 1 : -1;
    const double r = 0.5 * count - 0.3;
    ClearDisc(far_u + sign * toward_near * (p - u), far_v + sign * toward_near * (q - v), r, keep);
  });
}

VOLALIGN_INLINE bool IsMixed(float a, float m, float b) {
  const float jump = b - a;
  const float share = (m - a) / jump;
  return !((std::abs(jump) < kMixedJump) | (a <= 0) | (b <= 0)) & (share > kMixedLow) &
         (share < kMixedHigh);
}

/// mixed[u]: whether `here` lies between both neighbours of its row or its column, if these differ
/// by at least kMixedJump. `above` and `below` may be null.
VOLALIGN_CLONES void FindMixed(const float* __restrict above, const float* __restrict here,
                               const float* __restrict below, int count,
                               std::uint8_t* __restrict mixed) {
  mixed[0] = mixed[count - 1] = 0;
  for (int u = 1; u + 1 < count; ++u) mixed[u] = IsMixed(here[u - 1], here[u], here[u + 1]);
  if (above == nullptr || below == nullptr) return;
  for (int u = 0; u < count; ++u) {
    mixed[u] |= static_cast<std::uint8_t>(IsMixed(above[u], here[u], below[u]));
  }
}

/// The vendor removes most pixels that mix two surfaces: those at mid-depth between neighbours.
void DropMixedPixels(RandomStream& random, const DepthImage& depth, Image<std::uint8_t>* keep) {
  const PixelRandom pixel(random);
  const int width = depth.width();
  std::vector<std::uint8_t> mixed(static_cast<std::size_t>(width) + 7);
  for (int v = 0; v < depth.height(); ++v) {
    const float* const row = &depth(0, v);
    FindMixed(v > 0 ? row - width : nullptr, row, v + 1 < depth.height() ? row + width : nullptr,
              width, mixed.data());
    ForEachSet(mixed, width, [&](int u) {
      const auto i = static_cast<std::uint64_t>(v) * static_cast<std::uint64_t>(width) +
                     static_cast<std::uint64_t>(u);
      if (pixel.Uniform(i) < kMixedDetected) (*keep)(u, v) = 0;
    });
  }
}

/// One frame's part of each effect.
struct FrameNoise {
  TofDevice device;
  Image<float> patches;  // a unit normal field
  float patch_limit;
  Image<float> grain;  // of the white noise, unit variance
};

FrameNoise DrawFrameNoise(int width, int height, double scale, RandomStream& random) {
  FrameNoise frame;
  TofDevice& device = frame.device;
  device.bias = static_cast<float>(Draw(kBias, random));
  device.white = static_cast<float>(Draw(kWhiteGain, random));
  device.warp_rms = static_cast<float>(Draw(kWarpRms, random));
  device.multipath = static_cast<float>(Draw(kMultipath, random));
  device.fill = static_cast<float>(Draw(kFill, random));
  device.threshold = static_cast<float>(
      std::exp(random.Uniform(std::log(kAmplitudeThreshold[0]), std::log(kAmplitudeThreshold[1]))));
  const double warp_correlation =
      scale * kShortestWarp * std::exp(random.Uniform(0, std::log(kWarpRatio)));
  device.warp = SmoothField(width, height, warp_correlation, random);
  frame.patches = SmoothField(width, height, scale * Draw(kPatchCorrelation, random), random);
  frame.patch_limit = static_cast<float>(Draw(kPatchLimit, random));
  const PixelRandom pixel(random);
  frame.grain = Image<float>(width, height);
  pixel.Normals(0, static_cast<int>(frame.grain.size()), frame.grain.data());
  SmoothUnitNoise(kGrainSigma * scale, kGrainSigma * scale, &frame.grain);
  return frame;
}

/// A row of pixels. Faces, rays and the three numbers of a face are [count], rays as pairs (x, y).
struct TofRow {
  int count;
  const std::uint16_t* faces;
  const float *depth, *rays;  ///< depth of the clean view
  const float *height, *reflectivity, *patch_limit;
  const float *warp, *grain, *patches;
  float bias, warp_rms, white, threshold;
};

/// error[u] of depth, m, without that of seams. Clears `keep` if too little light returns.
VOLALIGN_CLONES void MeasureRow(const TofRow& row, float* __restrict error,
                                std::uint8_t* __restrict keep) {
  const float* __restrict rays = row.rays;
  for (int u = 0; u < row.count; ++u) {
    const float z = row.depth[u];
    const float x = rays[2 * u], y = rays[2 * u + 1];
    const float range = z * std::sqrt(x * x + y * y + 1);
    const float cosine = std::max(row.height[u] / range, 0.01F);
    const float inverse = 1 / std::max(cosine, kLeastNoiseCosine);
    const float grazing = inverse * (0.7F + 0.3F * std::sqrt(inverse));
    error[u] = row.bias + row.warp_rms * row.warp[u] +
               row.white * (kWhiteNoise + kWhiteNoiseSlope * z) * grazing * row.grain[u];
    const float amplitude = row.reflectivity[u] * cosine / (range * range);
    const float wave = 1 + kPatchWave * row.patches[u];
    const bool lost = (row.faces[u] == 0) |
                      (amplitude < row.threshold * wave * wave * wave * wave) |
                      (row.patches[u] > row.patch_limit[u]) | (z > kFarthest);
    keep[u] = lost ? std::uint8_t{0} : keep[u];
  }
}

/// Adjacent pixels of one face, in front of which boxes rise.
struct SeamRow {
  int count;
  const float *depth, *rays;
  Eigen::Matrix<float, 3, 3, Eigen::RowMajor> rotation;  ///< structure_from_sensor
  Eigen::Vector3f eye;                                   ///< in the structure's frame, m
  const std::vector<SeamBox>& boxes;
  const std::vector<std::uint16_t>* rising;  ///< those before the face
  bool meets_floor;
  float floor;            ///< its height, m
  float multipath, fill;  ///< m: errors at a seam
};

/// Sums in Eigen's order.
VOLALIGN_INLINE float Dot(float ax, float ay, float az, float bx, float by, float bz) {
  return ax * bx + (ay * by + az * bz);
}

/// Adds the nearest seam's effect to error[u]. `scratch` has 4 `count` numbers.
VOLALIGN_CLONES void AddSeams(const SeamRow& row, float* __restrict error,
                              float* __restrict scratch) {
  const int count = row.count;
  float* __restrict px = scratch;
  float* __restrict py = scratch + count;
  float* __restrict pz = scratch + 2 * count;
  float* __restrict nearest = scratch + 3 * count;
  const float* __restrict depth = row.depth, * __restrict rays = row.rays;
  const float* const r = row.rotation.data();
  const float* const eye = row.eye.data();
  const float eye_x = eye[0], eye_y = eye[1], eye_z = eye[2];
  for (int u = 0; u < count; ++u) {
    const float x = rays[2 * u], y = rays[2 * u + 1], z = depth[u];
    px[u] = eye_x + Dot(z * r[0], z * r[1], z * r[2], x, y, 1);
    py[u] = eye_y + Dot(z * r[3], z * r[4], z * r[5], x, y, 1);
    pz[u] = eye_z + Dot(z * r[6], z * r[7], z * r[8], x, y, 1);
    nearest[u] = kMultipathReach;
  }
  for (const std::uint16_t b : *row.rising) {
    const SeamBox box = row.boxes[b];
    const float *const q = box.rotation.data(), *const centre = box.centre.data(),
                       *const half = box.half.data();
    for (int u = 0; u < count; ++u) {
      const float dx = centre[0] - px[u], dy = centre[1] - py[u], dz = centre[2] - pz[u];
      const float x = std::max(std::abs(Dot(q[0], q[1], q[2], dx, dy, dz)) - half[0], 0.0F);
      const float y = std::max(std::abs(Dot(q[3], q[4], q[5], dx, dy, dz)) - half[1], 0.0F);
      const float z = std::max(std::abs(Dot(q[6], q[7], q[8], dx, dy, dz)) - half[2], 0.0F);
      nearest[u] = std::min(nearest[u], std::sqrt(Dot(x, y, z, x, y, z)));
    }
  }
  if (row.meets_floor) {
    const float floor = row.floor;
    for (int u = 0; u < count; ++u)
      nearest[u] = std::min(nearest[u], std::max(py[u] - floor, 0.0F));
  }
  const float multipath = row.multipath, fill = row.fill;
  for (int u = 0; u < count; ++u) {
    error[u] += multipath * (1 - nearest[u] / kMultipathReach) -
                fill * std::max(1 - nearest[u] / kFillReach, 0.0F);
  }
}

/// Adds the depth errors of `frame`, and clears `keep` where too little light returns.
void MeasureDepth(const NoiseInput& input, const FrameNoise& frame, DepthImage* depth,
                  Image<std::uint8_t>* keep) {
  const RenderedView& view = input.view;
  const TofDevice& device = frame.device;
  const Seams seams = SeamsOf(input);
  const std::vector<TofFace> infos = TofFaces(input, seams);
  const std::vector<std::uint16_t> no_seams;
  SeamRow seam{0,
               nullptr,
               nullptr,
               input.structure_from_sensor.linear().cast<float>(),
               input.structure_from_sensor.translation().cast<float>(),
               seams.boxes,
               nullptr,
               false,
               static_cast<float>(input.structure.FloorHeight()),
               device.multipath,
               device.fill};
  const int width = depth->width();
  const auto columns = static_cast<std::size_t>(width);
  std::vector<float> of_faces(3 * columns), error(columns), scratch(4 * columns);
  TofRow row{};
  row.count = width;
  row.height = of_faces.data();
  row.reflectivity = of_faces.data() + columns;
  row.patch_limit = of_faces.data() + 2 * columns;
  row.bias = device.bias;
  row.warp_rms = device.warp_rms;
  row.white = device.white;
  row.threshold = device.threshold;
  for (int v = 0; v < depth->height(); ++v) {
    const std::size_t first = static_cast<std::size_t>(v) * columns;
    row.faces = &view.faces[first];
    row.depth = &view.depth[first];
    row.rays = view.rays->rays[first].data();
    row.warp = &device.warp[first];
    row.grain = &frame.grain[first];
    row.patches = &frame.patches[first];
    ForEachRun(row.faces, width, [&](int begin, int end, std::size_t face) {
      float* const to = of_faces.data() + begin;
      std::fill_n(to, end - begin, infos[face].height);
      std::fill_n(to + columns, end - begin, infos[face].reflectivity);
      std::fill_n(
          to + 2 * columns, end - begin,
          infos[face].is_structure ? frame.patch_limit + kStructurePatchLimit : frame.patch_limit);
    });
    MeasureRow(row, error.data(), &(*keep)[first]);
    ForEachRun(row.faces, width, [&](int begin, int end, std::size_t face) {
      const auto& rising = infos[face].seams < 0
                               ? no_seams
                               : seams.rising[static_cast<std::size_t>(infos[face].seams)];
      if (infos[face].meets_floor || !rising.empty()) {
        seam.count = end - begin;
        seam.depth = row.depth + begin;
        seam.rays = row.rays + std::ptrdiff_t{2} * begin;
        seam.rising = &rising;
        seam.meets_floor = infos[face].meets_floor;
        AddSeams(seam, &error[static_cast<std::size_t>(begin)], scratch.data());
      }
      for (int u = begin; u < end; ++u) {
        (*depth)(u, v) = row.depth[u] + error[static_cast<std::size_t>(u)];
      }
    });
  }
}

/// Clears small ellipses at random places.
void ClearSpeckles(double scale, RandomStream& random, Image<std::uint8_t>* keep) {
  const int width = keep->width(), height = keep->height();
  const int speckles = DrawPoisson(kSpeckles * Draw(kSpeckleGain, random) * width * height /
                                       (kTofWidth * kTofHeight) / (scale * scale),
                                   random);
  for (int k = 0; k < speckles; ++k) {
    const double u = random.Uniform(0, width), v = random.Uniform(0, height);
    const double a = scale * Draw(kSpeckleRadius, random);
    const double b = scale * Draw(kSpeckleRadius, random);
    ClearEllipse(u, v, a, b, random.Uniform(0, 3.14159), keep);
  }
}

}  // namespace

double DrawHexagonCentre(RandomStream& random) { return Draw(kHexagonCentreU, random); }

void ClearOutsideHexagon(int width, int height, double centre_u, Image<std::uint8_t>* keep) {
  const double su = kTofWidth / width, sv = kTofHeight / height;
  for (int v = 0; v < height; ++v) {
    const double dv = (v + 0.5) * sv - 0.5 - kHexagonCentreV;
    const double half =
        kHexagonHalfWidth - (dv < 0 ? -kHexagonSlopeAbove : kHexagonSlopeBelow) * dv;
    const auto is_outside = [&](int u) { return std::abs((u + 0.5) * su - 0.5 - centre_u) > half; };
    int left = 0, right = width - 1;
    for (; left < width && is_outside(left); ++left) (*keep)(left, v) = 0;
    for (; right > left && is_outside(right); --right) (*keep)(right, v) = 0;
  }
}

NoisyView TofNoise(const TofModel& model, const NoiseInput& input, RandomStream& random,
                   std::optional<TofDevice>* device) {
  const int width = input.view.depth.width(), height = input.view.depth.height();
  const double scale = width / kTofWidth;
  NoisyView out{DepthImage(width, height), input.view.labels};
  Image<std::uint8_t> keep(width, height, 1);
  FrameNoise frame = DrawFrameNoise(width, height, scale, random);
  if (*device) frame.device = std::move(**device);
  MeasureDepth(input, frame, &out.depth, &keep);
  AddEdgeNoise(input.view, scale, random, &out, &keep);
  DropMixedPixels(random, out.depth, &keep);
  ClearSpeckles(scale, random, &keep);
  if (model.hexagon) {
    if (!*device) frame.device.mask_centre_u = DrawHexagonCentre(random);
    ClearOutsideHexagon(width, height, frame.device.mask_centre_u, &keep);
  }
  *device = std::move(frame.device);
  RoundKept(keep, &out);
  return out;
}

}  // namespace volalign
