#include "render/noise_models.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "render/noise_fields.h"

namespace volalign {
namespace {

// Pixel figures of facts/sensors.md, section 2, are for images 320 px wide.
constexpr double kReferenceWidth = 320;

/// What the matcher sees: foreground grown by about a pixel, wavy. Labels follow the surface whose
/// depth is taken.
void Fatten(const NoiseInput& input, double scale, RandomStream& random, DepthImage* depth,
            LabelImage* labels, Image16* faces) {
  const RenderedView& view = input.view;
  const int width = view.depth.width(), height = view.depth.height();
  const Image<float> du = SmoothField(width, height, 6 * scale, random);
  const Image<float> dv = SmoothField(width, height, 6 * scale, random);
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
      const bool take =
          there > 0 && (here == 0 || there < here - 0.05F) && view.faces(p, q) != view.faces[i];
      (*depth)[i] = take ? there : here;
      (*labels)[i] = take ? view.labels(p, q) : view.labels[i];
      (*faces)[i] = take ? view.faces(p, q) : view.faces[i];
    }
  }
}

}  // namespace

NoisyView StereoNoise(const StereoModel& model, const NoiseInput& input, RandomStream& random) {
  const RenderedView& view = input.view;
  const int width = view.depth.width(), height = view.depth.height();
  const double scale = width / kReferenceWidth;
  const auto image_fb =
      static_cast<float>(model.focal_baseline * width / model.native_width);  // px of this image
  const auto native_fb = static_cast<float>(model.focal_baseline);

  NoisyView out{DepthImage(width, height), LabelImage(width, height)};
  Image16 faces(width, height);
  Fatten(input, scale, random, &out.depth, &out.labels, &faces);

  // Depth edges: 14 % have a pixel that averages both surfaces; a third loses a strip besides the
  // half-occlusion below.
  const Image<float> edge_loss = SmoothField(width, height, 15 * scale, random);
  const PixelRandom edge_dice(random);
  Image<std::uint8_t> keep(width, height, 1);
  const auto visit_edge = [&](int u, int v, int p, int q) {
    if (faces(u, v) == faces(p, q)) return;
    const float a = out.depth(u, v), b = out.depth(p, q);
    if (a == 0 || b == 0 || std::abs(a - b) < 0.06F) return;
    const int far_u = a > b ? u : p, far_v = a > b ? v : q;
    const std::uint64_t id =
        2 * (static_cast<std::uint64_t>(v) * static_cast<std::uint64_t>(width) +
             static_cast<std::uint64_t>(u)) +
        static_cast<std::uint64_t>(q - v);
    const float dice = edge_dice.Uniform(id);
    const float loss = edge_loss(u, v) - 0.75F;
    if (loss > 0) {
      const double r = scale * std::min(0.5 + 2.0 * loss, 2.5) - 0.4 + 0.4 * dice;
      if (r > 0) ClearDisc(far_u, far_v, r, &keep);
    } else if (dice < 0.10F && v == q) {
      const float w = 0.2F + 0.6F * (dice / 0.10F);
      out.depth(far_u, far_v) = w * a + (1 - w) * b;
      out.labels(far_u, far_v) = 0;
    }
  };
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      if (u + 1 < width) visit_edge(u, v, u + 1, v);
      if (v + 1 < height) visit_edge(u, v, u, v + 1);
    }
  }

  const double local_sigma = random.Uniform(model.local_sigma[0], model.local_sigma[1]);
  const double warp_sigma = random.Uniform(model.warp_sigma[0], model.warp_sigma[1]);
  const Image<float> warp = SmoothField(width, height, scale * random.Uniform(10, 40), random);
  const PixelRandom pixel(random);
  Image<float> local(width, height);
  for (std::size_t i = 0; i < local.size(); ++i) local[i] = pixel.Normal(i);
  SmoothUnitNoise(1.2 * scale, 0.9 * scale, &local);

  // Matching succeeds where texture outweighs distance, incidence and two random fields.
  const Image<float> coarse = SmoothField(width, height, scale * random.Uniform(40, 100), random);
  const Image<float> fine = SmoothField(width, height, scale * random.Uniform(3, 10), random);
  const auto quality = static_cast<float>(random.Uniform(-0.3, 1.0));
  const auto structure_quality = static_cast<float>(random.Uniform(2.3, 3.6));

  const Eigen::Vector3d eye = input.structure_from_sensor.translation();
  struct FaceInfo {
    float height, texture;
    bool is_structure;
  };
  std::vector<FaceInfo> infos(input.mesh.faces.size());
  for (std::size_t i = 0; i < infos.size(); ++i) {
    const SceneFace& face = input.mesh.faces[i];
    const SceneObject& object = input.mesh.objects[static_cast<std::size_t>(face.object)];
    infos[i] = {static_cast<float>(face.normal.dot(eye) - face.offset), object.texture,
                object.is_structure};
  }
  const auto fx = static_cast<float>(input.intrinsics.fx),
             cx = static_cast<float>(input.intrinsics.cx);
  const auto fy = static_cast<float>(input.intrinsics.fy),
             cy = static_cast<float>(input.intrinsics.cy);
  const auto largest_image_disparity =
      static_cast<float>(model.largest_disparity * width / model.native_width);
  const auto margin = static_cast<float>(0.5 * scale);
  for (int v = 0; v < height; ++v) {
    const float y = (static_cast<float>(v) - cy) / fy;
    // Column of the right image that a surface further right covers already: what lies behind it is
    // seen by the left camera alone.
    float covered = 1e9F;
    for (int u = width - 1; u >= 0; --u) {
      const std::size_t i = static_cast<std::size_t>(v) * static_cast<std::size_t>(width) +
                            static_cast<std::size_t>(u);
      const float z = out.depth[i];
      if (faces[i] == 0 || z <= 0) {
        keep[i] = 0;
        continue;
      }
      const FaceInfo& face = infos[faces[i] - 1U];
      const float x = (static_cast<float>(u) - cx) / fx;
      const float disparity = image_fb / z;
      const float column = static_cast<float>(u) - disparity;
      const bool occluded = column > covered + margin;
      covered = std::min(covered, column);
      const float cosine = std::min(face.height / (z * std::sqrt(x * x + y * y + 1)), 1.0F);
      const float offset = face.is_structure ? structure_quality
                                             : quality + 2.2F * (face.texture - 0.45F) -
                                                   0.25F * std::max(z - 2.5F, 0.0F);
      const float confidence = offset - 2.0F * std::max(0.35F - cosine, 0.0F) -
                               8.0F * std::max(0.22F - cosine, 0.0F) + 0.9F * coarse[i] +
                               0.4F * fine[i];
      if (occluded || column < 0 || confidence < 0 || disparity > largest_image_disparity ||
          v == 0) {
        keep[i] = 0;
        continue;
      }
      const auto error =
          static_cast<float>(local_sigma) * local[i] + static_cast<float>(warp_sigma) * warp[i];
      out.depth[i] = native_fb / std::max(native_fb / z + error, 0.5F);
    }
  }
  for (std::size_t i = 0; i < keep.size(); ++i) {
    if (!keep[i]) {
      out.depth[i] = 0;
      out.labels[i] = 0;
    } else {
      out.depth[i] = std::nearbyint(out.depth[i] * 1000) * 0.001F;
    }
  }
  return out;
}

}  // namespace volalign
