#include "render/noise_models.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "render/noise_fields.h"

namespace volalign {
namespace {

// Figures of facts/sensors.md, section 1, are for images 320 px wide.
constexpr double kReferenceWidth = 320;
constexpr float kMultipathReach = 0.3F;  // m
constexpr float kFillReach = 0.06F;      // m, of the spatial filter that rounds concave corners

/// Face data that every pixel needs.
struct FaceInfo {
  float height = 0;        // distance of the eye from the plane, m
  float reflectivity = 0;  // 0..1
  bool is_structure = false;
  bool meets_floor = false;      // an upright side of the structure
  std::uint64_t seam_boxes = 0;  // bit b: box b rises in front of this face, a concave seam
};

/// A box of the structure in its own frame, to find the concave seams near a point.
struct SeamBox {
  Eigen::Matrix3f box_from_structure;
  Eigen::Vector3f centre;
  Eigen::Vector3f half;
  float reach_squared;  // of the sphere around it that holds all points within kMultipathReach

  /// How far the box reaches along n, from the origin, m.
  float Support(const Eigen::Vector3f& n) const {
    return n.dot(centre) + (box_from_structure * n).cwiseAbs().dot(half);
  }
};

/// Width in px (at 320) of the run of lost pixels at a depth edge whose quantile is q: 0 px 33 %, 1
/// px 16 %, 2 px 19 %, 3 px 11 %, 4 to 12 px 21 %.
float GapWidth(float q) {
  if (q < 0.33F) return 0;
  if (q < 0.49F) return 1;
  if (q < 0.68F) return 2;
  if (q < 0.79F) return 3;
  const float t = (q - 0.79F) / 0.21F;
  return 4 + 8 * t * t * t;
}

float NormalCdf(float x) { return 0.5F * std::erfc(-0.70710678F * x); }

std::vector<SeamBox> SeamBoxes(const NoiseInput& input) {
  std::vector<SeamBox> boxes;
  const bool present = std::any_of(input.mesh.objects.begin(), input.mesh.objects.end(),
                                   [](const SceneObject& o) { return o.is_structure; });
  if (!present) return boxes;
  for (const Box& box : input.structure.boxes()) {
    const Eigen::Vector3f half = (0.5 * box.size).cast<float>();
    const float reach = half.norm() + kMultipathReach;
    boxes.push_back({box.structure_from_box.linear().transpose().cast<float>(),
                     box.structure_from_box.translation().cast<float>(), half, reach * reach});
  }
  return boxes;
}

std::vector<FaceInfo> FaceInfos(const NoiseInput& input, const std::vector<SeamBox>& boxes) {
  constexpr double kRise = 0.02;  // m
  const Eigen::Vector3d eye = input.structure_from_sensor.translation();
  const double floor = input.structure.FloorHeight();
  std::vector<FaceInfo> infos(input.mesh.faces.size());
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
    for (std::size_t b = 0; b < boxes.size(); ++b) {
      if (boxes[b].Support(face.normal.cast<float>()) > face.offset + kRise) {
        infos[i].seam_boxes |= std::uint64_t{1} << b;
      }
    }
  }
  return infos;
}

/// Distance from a point to the nearest of the boxes that rise in front of its face,
/// kMultipathReach at most.
float SeamDistance(const std::vector<SeamBox>& boxes, std::uint64_t seam_boxes,
                   const Eigen::Vector3f& p) {
  float nearest = kMultipathReach;
  for (std::size_t b = 0; b < boxes.size(); ++b) {
    if ((seam_boxes >> b & 1) == 0) continue;
    const Eigen::Vector3f d = boxes[b].centre - p;
    if (d.squaredNorm() > boxes[b].reach_squared) continue;
    const Eigen::Vector3f outside =
        ((boxes[b].box_from_structure * d).cwiseAbs() - boxes[b].half).cwiseMax(0.0F);
    nearest = std::min(nearest, outside.norm());
  }
  return nearest;
}

void ClearOutsideHexagon(int width, int height, RandomStream& random, Image<std::uint8_t>* keep) {
  constexpr double kCentreV = 147.6, kHalfWidth = 175.2, kAbove = 0.557, kBelow = 0.600;
  const double centre_u = random.Uniform(158, 170);
  const double su = 320.0 / width, sv = 288.0 / height;
  for (int v = 0; v < height; ++v) {
    const double dv = (v + 0.5) * sv - 0.5 - kCentreV;
    const double half = kHalfWidth - (dv < 0 ? -kAbove : kBelow) * dv;
    for (int u = 0; u < width; ++u) {
      if (std::abs((u + 0.5) * su - 0.5 - centre_u) > half) (*keep)(u, v) = 0;
    }
  }
}

/// Gaps along depth edges, and flying pixels where there is no gap.
void SpoilEdges(const NoiseInput& input, double scale, RandomStream& random, DepthImage* depth,
                LabelImage* labels, Image<std::uint8_t>* keep) {
  const DepthImage& clean = input.view.depth;
  const int width = clean.width(), height = clean.height();
  const Image<float> coherence = SmoothField(width, height, 25 * scale, random);
  const PixelRandom pixel(random);
  const auto visit = [&](int u, int v, int du, int dv) {
    if (input.view.faces(u, v) == input.view.faces(u + du, v + dv)) return;
    const float a = clean(u, v), b = clean(u + du, v + dv);
    const float jump = std::abs(a - b);
    if (a == 0 || b == 0 || jump < 0.08F) return;
    const std::uint64_t id =
        2 * (static_cast<std::uint64_t>(v) * static_cast<std::uint64_t>(width) +
             static_cast<std::uint64_t>(u)) +
        static_cast<std::uint64_t>(dv);
    const float share = std::min((jump - 0.08F) / 0.22F, 1.0F);
    const float far = std::clamp(std::max(a, b) / 3.0F, 0.5F, 1.2F);
    const float gap = GapWidth(NormalCdf(0.95F * coherence(u, v) + 0.31F * pixel.Normal(2 * id))) *
                      share * far * static_cast<float>(scale);
    const float dice = pixel.Uniform(2 * id + 1);
    const int count = static_cast<int>(gap + dice);
    const bool first_is_far = a > b;
    const int far_u = first_is_far ? u : u + du, far_v = first_is_far ? v : v + dv;
    if (count == 0) {
      if (dice < 0.09F) {  // 3 % of all edges
        const float near_z = std::min(a, b);
        (*depth)(far_u, far_v) = near_z + jump * (0.2F + 0.6F * (dice / 0.09F));
        (*labels)(far_u, far_v) = 0;
      }
      return;
    }
    const double toward_near = count % 2 == 0 ? 0.5 : 0.0;
    const double sign = first_is_far ? 1 : -1;
    const double r = 0.5 * count - 0.3;
    ClearDisc(far_u + sign * toward_near * du, far_v + sign * toward_near * dv, r, keep);
  };
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      if (u + 1 < width) visit(u, v, 1, 0);
      if (v + 1 < height) visit(u, v, 0, 1);
    }
  }
}

/// The vendor invalidates most pixels that mix two surfaces: at mid-depth between neighbours.
void DropMixedPixels(RandomStream& random, const DepthImage& depth, Image<std::uint8_t>* keep) {
  constexpr float kDetected = 0.7F;
  const PixelRandom pixel(random);
  const auto mixed = [](float a, float m, float b) {
    const float jump = b - a;
    if (std::abs(jump) < 0.3F || a <= 0 || b <= 0) return false;
    const float share = (m - a) / jump;
    return share > 0.15F && share < 0.85F;
  };
  for (int v = 0; v < depth.height(); ++v) {
    for (int u = 0; u < depth.width(); ++u) {
      const float m = depth(u, v);
      const bool found =
          (u > 0 && u + 1 < depth.width() && mixed(depth(u - 1, v), m, depth(u + 1, v))) ||
          (v > 0 && v + 1 < depth.height() && mixed(depth(u, v - 1), m, depth(u, v + 1)));
      if (!found) continue;
      const auto i = static_cast<std::uint64_t>(v) * static_cast<std::uint64_t>(depth.width()) +
                     static_cast<std::uint64_t>(u);
      if (pixel.Uniform(i) < kDetected) (*keep)(u, v) = 0;
    }
  }
}

}  // namespace

NoisyView TofNoise(const TofModel& model, const NoiseInput& input, RandomStream& random) {
  const RenderedView& view = input.view;
  const int width = view.depth.width(), height = view.depth.height();
  const double scale = width / kReferenceWidth;
  NoisyView out{DepthImage(width, height), view.labels};
  Image<std::uint8_t> keep(width, height, 1);

  const auto bias = static_cast<float>(random.Uniform(-0.011, 0.011));
  const auto white = static_cast<float>(random.Uniform(0.75, 1.25));
  const auto warp_rms = static_cast<float>(random.Uniform(0.0014, 0.0056));
  const auto multipath = static_cast<float>(random.Uniform(0, 0.025));
  const auto fill = static_cast<float>(random.Uniform(0, 0.02));
  const auto threshold =
      static_cast<float>(std::exp(random.Uniform(std::log(0.001), std::log(0.004))));
  const Image<float> warp =
      SmoothField(width, height, scale * 12 * std::exp(random.Uniform(0, std::log(5.0))), random);
  const Image<float> patches = SmoothField(width, height, scale * random.Uniform(10, 30), random);
  const auto patch_limit = static_cast<float>(random.Uniform(1.2, 2.1));
  const PixelRandom pixel(random);
  Image<float> grain(width, height);
  for (std::size_t k = 0; k < grain.size(); ++k) grain[k] = pixel.Normal(k);
  SmoothUnitNoise(0.62 * scale, 0.62 * scale, &grain);

  const std::vector<SeamBox> boxes = SeamBoxes(input);
  const std::vector<FaceInfo> infos = FaceInfos(input, boxes);
  const Eigen::Matrix3f rotation = input.structure_from_sensor.linear().cast<float>();
  const Eigen::Vector3f eye = input.structure_from_sensor.translation().cast<float>();
  const auto floor = static_cast<float>(input.structure.FloorHeight());
  const auto fx = static_cast<float>(input.intrinsics.fx),
             cx = static_cast<float>(input.intrinsics.cx);
  const auto fy = static_cast<float>(input.intrinsics.fy),
             cy = static_cast<float>(input.intrinsics.cy);
  std::size_t i = 0;
  for (int v = 0; v < height; ++v) {
    const float y = (static_cast<float>(v) - cy) / fy;
    for (int u = 0; u < width; ++u, ++i) {
      const float z = view.depth[i];
      if (view.faces[i] == 0) {
        keep[i] = 0;
        continue;
      }
      const FaceInfo& face = infos[view.faces[i] - 1U];
      const float x = (static_cast<float>(u) - cx) / fx;
      const float ray = std::sqrt(x * x + y * y + 1);
      const float range = z * ray;
      const float cosine = std::max(face.height / range, 0.01F);
      const float inverse = 1 / std::max(cosine, 0.15F);
      const float grazing = inverse * (0.7F + 0.3F * std::sqrt(inverse));
      float error =
          bias + warp_rms * warp[i] + white * (0.00012F + 0.0001F * z) * grazing * grain[i];
      if (face.meets_floor || face.seam_boxes != 0) {
        const Eigen::Vector3f p = eye + z * (rotation * Eigen::Vector3f(x, y, 1));
        float seam = SeamDistance(boxes, face.seam_boxes, p);
        if (face.meets_floor) seam = std::min(seam, std::max(p.y() - floor, 0.0F));
        error +=
            multipath * (1 - seam / kMultipathReach) - fill * std::max(1 - seam / kFillReach, 0.0F);
      }
      out.depth[i] = z + error;

      const float amplitude = face.reflectivity * cosine / (range * range);
      const float limit = face.is_structure ? patch_limit + 1.3F : patch_limit;
      const float wave = 1 + 0.125F * patches[i];  // its 4th power is close to exp(patches / 2)
      if (amplitude < threshold * wave * wave * wave * wave || patches[i] > limit || z > 16.0F) {
        keep[i] = 0;
      }
    }
  }

  SpoilEdges(input, scale, random, &out.depth, &out.labels, &keep);
  DropMixedPixels(random, out.depth, &keep);
  const int speckles = DrawPoisson(
      25.0 * random.Uniform(0.2, 2.0) * width * height / (320.0 * 288.0) / (scale * scale), random);
  for (int k = 0; k < speckles; ++k) {
    const double u = random.Uniform(0, width), v = random.Uniform(0, height);
    const double a = scale * random.Uniform(0.7, 3), b = scale * random.Uniform(0.7, 3);
    ClearEllipse(u, v, a, b, random.Uniform(0, 3.14159), &keep);
  }
  if (model.hexagon) ClearOutsideHexagon(width, height, random, &keep);
  for (std::size_t k = 0; k < keep.size(); ++k) {
    if (!keep[k] || out.depth[k] <= 0) {
      out.depth[k] = 0;
      out.labels[k] = 0;
    } else {
      out.depth[k] = std::nearbyint(out.depth[k] * 1000) * 0.001F;
    }
  }
  return out;
}

}  // namespace volalign
