#include "render/infrared.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "core/base/random.h"
#include "core/base/statistics.h"

namespace volalign {

namespace {

// Light. A lamp at the camera gives as much light at kLampRange as the room does on average.
constexpr double kRoomLight = 0.5;
constexpr double kLampRange = 2.0;    // m
constexpr double kBrightShare = 0.9;  // rank of the pixel that decides the exposure
constexpr double kBlurReach = 3.0;    // standard deviations

using Radiance = Image<float>;

/// Share of light that a point of a side with a print reflects; `otherwise` beyond the paper.
double PrintReflectivity(const Side& side, const GreyImage& cells, const Eigen::Vector3d& p,
                         const InfraredConfig& config, double otherwise) {
  const double x = side.axis_u.dot(p - side.centre), y = -side.axis_v.dot(p - side.centre);
  const double half = 0.5 * config.marker_m, paper = half + config.quiet_zone_m;
  if (std::abs(x) > paper || std::abs(y) > paper) return otherwise;
  if (std::abs(x) >= half || std::abs(y) >= half) return config.white;
  const auto cell = [&](double at, int count) {
    return std::clamp(static_cast<int>((at + half) / config.marker_m * count), 0, count - 1);
  };
  return cells(cell(x, cells.width()), cell(y, cells.height())) > 0 ? config.white : config.black;
}

/// Light that returns along each ray.
Radiance Shade(const RenderedView& view, const SceneMesh& mesh, const Structure& built,
               const std::vector<MarkerPrint>& prints, const Pose& structure_from_sensor,
               const InfraredConfig& config) {
  std::vector<const GreyImage*> print_of(static_cast<std::size_t>(built.num_classes()), nullptr);
  for (const MarkerPrint& print : prints)
    print_of.at(static_cast<std::size_t>(print.label)) = &print.cells;
  Radiance image(view.depth.width(), view.depth.height(), 0.0F);
  for (int v = 0; v < image.height(); ++v) {
    for (int u = 0; u < image.width(); ++u) {
      const double z = view.depth(u, v);
      if (!(z > 0)) continue;
      const SceneFace& face = mesh.faces[view.faces(u, v) - 1U];
      const Eigen::Vector2f& ray = view.rays->at(u, v);
      const Eigen::Vector3d from_sensor(z * ray.x(), z * ray.y(), z);
      double reflectivity = mesh.objects[static_cast<std::size_t>(face.object)].reflectivity;
      const int label = view.labels(u, v);
      if (const GreyImage* cells = print_of[static_cast<std::size_t>(label)]) {
        reflectivity = PrintReflectivity(built.SideOfLabel(label), *cells,
                                         structure_from_sensor * from_sensor, config, reflectivity);
      }
      const double range = from_sensor.norm();
      const double cosine =
          std::abs(face.normal.dot(structure_from_sensor.linear() * from_sensor) / range);
      const double lamp = cosine * kLampRange * kLampRange / (range * range);
      image(u, v) = static_cast<float>(reflectivity * (kRoomLight + (1 - kRoomLight) * lamp));
    }
  }
  return image;
}

/// Means over `factor` x `factor` pixels.
Radiance Reduce(const Radiance& fine, int factor) {
  Radiance image(fine.width() / factor, fine.height() / factor, 0.0F);
  const float share = 1.0F / static_cast<float>(factor * factor);
  for (int v = 0; v < image.height() * factor; ++v) {
    for (int u = 0; u < image.width() * factor; ++u)
      image(u / factor, v / factor) += share * fine(u, v);
  }
  return image;
}

/// Blurs along rows (du = 1) or columns (dv = 1). The border is repeated.
Radiance BlurAlong(const Radiance& image, double sigma, int du, int dv) {
  const int reach = static_cast<int>(std::ceil(kBlurReach * sigma));
  std::vector<float> kernel;
  float sum = 0;
  for (int k = -reach; k <= reach; ++k) {
    kernel.push_back(static_cast<float>(std::exp(-0.5 * k * k / (sigma * sigma))));
    sum += kernel.back();
  }
  const float* const middle = kernel.data() + reach;
  Radiance out(image.width(), image.height(), 0.0F);
  for (int v = 0; v < image.height(); ++v) {
    for (int u = 0; u < image.width(); ++u) {
      for (int k = -reach; k <= reach; ++k) {
        out(u, v) += middle[k] / sum *
                     image(std::clamp(u + k * du, 0, image.width() - 1),
                           std::clamp(v + k * dv, 0, image.height() - 1));
      }
    }
  }
  return out;
}

/// Grey values of the pixels' light after the exposure time.
GreyImage Expose(const Radiance& image, const InfraredConfig& config, RandomStream& random) {
  const float bright = Quantile(std::vector<float>(image.begin(), image.end()), kBrightShare);
  const double gain = bright > 0 ? config.exposure / bright : 0;
  GreyImage grey(image.width(), image.height());
  for (std::size_t i = 0; i < image.size(); ++i) {
    double share = gain * image[i];
    if (config.full_well_electrons > 0) {
      const double electrons = share * config.full_well_electrons;
      const double sigma =
          std::sqrt(electrons + config.read_noise_electrons * config.read_noise_electrons);
      share = random.Normal(electrons, sigma) / config.full_well_electrons;
    }
    grey[i] = static_cast<std::uint8_t>(std::lround(255 * std::clamp(share, 0.0, 1.0)));
  }
  return grey;
}

}  // namespace

GreyImage RenderInfrared(const SceneMesh& mesh, const Structure& built,
                         const std::vector<MarkerPrint>& prints, const Intrinsics& intrinsics,
                         const Pose& structure_from_sensor, const InfraredConfig& config,
                         DepthRenderer& renderer, std::uint64_t seed, std::uint64_t index) {
  const int factor = config.supersampling;
  RenderedView view;
  renderer.Render(mesh, intrinsics.Resized(factor * intrinsics.width, factor * intrinsics.height),
                  structure_from_sensor, &view);
  Radiance image = Reduce(Shade(view, mesh, built, prints, structure_from_sensor, config), factor);
  if (config.blur_px > 0)
    image = BlurAlong(BlurAlong(image, config.blur_px, 1, 0), config.blur_px, 0, 1);
  RandomStream random(seed, index, "infrared");
  return Expose(image, config, random);
}

}  // namespace volalign
