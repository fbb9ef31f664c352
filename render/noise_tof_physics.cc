#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <vector>

#include "core/base/noise_fields.h"
#include "render/noise_models.h"
#include "render/subpixels.h"

namespace volalign {
namespace {

using Phasor = std::complex<float>;
// Modulation frequencies: the two higher ones of a Kinect v2 (Sell and O'Connor, "The Xbox One
// system on a chip and Kinect sensor", IEEE Micro 2014). It has a third one for whole turns, which
// are assumed to be counted correctly.
constexpr std::array<double, 2> kFrequencies = {80e6, 120e6};  // Hz
using Tones = std::array<Phasor, kFrequencies.size()>;
constexpr double kLightSpeed = 299792458;  // m/s
constexpr int kSubRays = 3;                // of a pixel at an edge, along each axis
// Shot noise of the lamp's light and of the room's. A face of reflectivity 0.6 at 2 m has 0.4 mm of
// white noise, as measured with an Azure Kinect (docs/sensor-models.md).
constexpr float kShotNoise = 0.0008F, kRoomLight = 0.03F;
// Remaining errors of the factory's calibration (standard deviations, m): an offset of the device,
// harmonics that four samples per period alias, and an offset of each pixel.
constexpr double kOffset = 0.004, kWiggling = 0.0015, kPixelOffset = 0.0003;
// Light that is scattered between lens and chip: its share, and the distance in px at which it
// falls to 1/e.
constexpr double kScattered[2] = {0.001, 0.006}, kScatterReach[2] = {20, 60};
constexpr int kScatterCell = 8;  // px
// Light that is reflected once more: from patches of so many px, at every so many pixels, and its
// least share of direct light to count. Surfaces are not all matt, and the lamp does not light all
// of the view. So a share is used with which the sides of the lowest box lean by 8 to 17 mm, as in
// real frames (docs/sensor-models.md).
constexpr double kDiffuseMultipath[2] = {0.1, 0.4};
constexpr int kPatch = 8, kBounceStep = 4;
constexpr float kLeastBounce = 2e-5F;
constexpr double kLeastAmplitude[2] = {0.001, 0.004};  // reflectivity cos / m^2, log-uniform
constexpr double kMostDisagreement = 0.06;             // m, of the two tones, in a delivered pixel
constexpr double kFlying = 0.03;  // m from its pixel's surface: a mixture without a label

/// The phases of a path of this length, times an amplitude.
Tones OfPath(float amplitude, double metres) {
  Tones tones;
  for (std::size_t k = 0; k < tones.size(); ++k) {
    tones[k] =
        std::polar(amplitude, static_cast<float>(std::remainder(
                                  2 * M_PI * kFrequencies[k] / kLightSpeed * metres, 2 * M_PI)));
  }
  return tones;
}

void Add(float weight, const Tones& from, Tones* to) {
  for (std::size_t k = 0; k < to->size(); ++k) (*to)[k] += weight * from[k];
}

struct Device {
  double offset, wiggling, wiggling_phase, bounced, scattered, scatter_reach, least_amplitude,
      centre_u;
  PixelRandom pixels;

  explicit Device(RandomStream random)
      : offset(random.Normal(0, kOffset)),
        wiggling(random.Normal(0, kWiggling)),
        wiggling_phase(random.Uniform(0, 2 * M_PI)),
        bounced(Draw(kDiffuseMultipath, random)),
        scattered(Draw(kScattered, random)),
        scatter_reach(Draw(kScatterReach, random)),
        least_amplitude(
            std::exp(random.Uniform(std::log(kLeastAmplitude[0]), std::log(kLeastAmplitude[1])))),
        centre_u(DrawHexagonCentre(random)),
        pixels(random) {}
};

/// A point of a surface under the sensor's lamp.
struct LitPoint {
  Eigen::Vector3f point, normal;
  float range = 0, cosine = 0, reflectivity = 0;

  LitPoint(const Subpixels& subpixels, int face, const Eigen::Vector3f& ray)
      : point(subpixels.Depth(face, ray) * ray),
        normal(subpixels.face(face).normal),
        range(point.norm()),
        cosine(std::max(0.0F, -normal.dot(point) / range)),
        reflectivity(subpixels.face(face).object->reflectivity) {}

  /// Amplitude of returning light, for a lamp of 1 at 1 m.
  float Amplitude() const { return reflectivity * cosine / (range * range); }
};

/// The light at a sensor: direct, mixed at edges, and reflected once between matt surfaces that it
/// sees.
class LightField {
 public:
  /// `bounced`: share of the reflected light.
  LightField(const NoiseInput& input, const Subpixels& subpixels, double bounced)
      : faces_(input.view.faces),
        subpixels_(subpixels),
        bounced_(static_cast<float>(bounced)),
        grid_width_((faces_.width() - 1) / kBounceStep + 2),
        grid_height_((faces_.height() - 1) / kBounceStep + 2) {
    const double pixel = 1 / (input.intrinsics.fx * input.intrinsics.fy);
    for (int v = kPatch / 2; v < faces_.height(); v += kPatch) {
      for (int u = kPatch / 2; u < faces_.width(); u += kPatch) {
        if (faces_(u, v) == 0) continue;
        const Eigen::Vector3f ray = subpixels.Ray(u, v);
        const LitPoint lit(subpixels, faces_(u, v) - 1, ray);
        if (!(lit.cosine > 0.02F)) continue;
        const double solid = kPatch * kPatch * pixel / std::pow(ray.norm(), 3);
        patches_.push_back({lit, static_cast<float>(solid) * lit.range * lit.range / lit.cosine});
      }
    }
    grid_.resize(static_cast<std::size_t>(grid_width_) * static_cast<std::size_t>(grid_height_));
    for (int j = 0; j < grid_height_; ++j) {
      for (int i = 0; i < grid_width_; ++i) {
        const int u = i * kBounceStep, v = j * kBounceStep;
        if (faces_.Contains(u, v) && faces_(u, v) != 0) Grid(i, j) = Bounced(u, v);
      }
    }
  }

  Tones At(int u, int v) const {
    Tones sum{};
    if (subpixels_.IsUniform(u, v)) {
      if (faces_(u, v) == 0) return sum;
      sum = Straight(faces_(u, v) - 1, subpixels_.Ray(u, v));
    } else {
      constexpr int kAll = kSubRays * kSubRays;
      for (int i = 0; i < kAll; ++i) {
        const int row = i / kSubRays, column = i % kSubRays;
        const Eigen::Vector3f ray =
            subpixels_.Ray(u + (column + 0.5) / kSubRays - 0.5, v + (row + 0.5) / kSubRays - 0.5);
        const int face = subpixels_.FaceAlong(ray, u, v);
        if (face >= 0) Add(1.0F / kAll, Straight(face, ray), &sum);
      }
    }
    if (faces_(u, v) != 0) Add(1, Interpolated(u, v), &sum);
    return sum;
  }

 private:
  struct Patch {
    LitPoint lit;
    float area;  // m^2
  };

  Tones Straight(int face, const Eigen::Vector3f& ray) const {
    const LitPoint lit(subpixels_, face, ray);
    return OfPath(lit.Amplitude(), 2 * lit.range);
  }

  /// Light that patches reflect onto a pixel's surface, by their form factors.
  Tones Bounced(int u, int v) const {
    Tones sum{};
    const LitPoint to(subpixels_, faces_(u, v) - 1, subpixels_.Ray(u, v));
    const float least = kLeastBounce * to.Amplitude();
    for (const auto& [from, area] : patches_) {
      const Eigen::Vector3f way = to.point - from.point;
      const float leaves = from.normal.dot(way), arrives = -to.normal.dot(way);
      if (!(leaves > 0 && arrives > 0)) continue;
      const float square = way.squaredNorm();
      const float form = leaves * arrives / (square * (static_cast<float>(M_PI) * square + area));
      const float amplitude = bounced_ * to.reflectivity * from.Amplitude() * area * form;
      if (amplitude < least) continue;
      Add(1, OfPath(amplitude, from.range + std::sqrt(square) + to.range), &sum);
    }
    return sum;
  }

  /// Interpolates between grid points, if they show the pixel's face.
  Tones Interpolated(int u, int v) const {
    const int i = u / kBounceStep, j = v / kBounceStep;
    const auto s = static_cast<float>(u % kBounceStep) / kBounceStep;
    const auto t = static_cast<float>(v % kBounceStep) / kBounceStep;
    Tones sum{};
    for (const auto& [p, q, weight] :
         {std::tuple{i, j, (1 - s) * (1 - t)}, std::tuple{i + 1, j, s * (1 - t)},
          std::tuple{i, j + 1, (1 - s) * t}, std::tuple{i + 1, j + 1, s * t}}) {
      if (weight == 0) continue;
      const int x = p * kBounceStep, y = q * kBounceStep;
      if (!faces_.Contains(x, y) || faces_(x, y) != faces_(u, v)) return Bounced(u, v);
      Add(weight, Grid(p, q), &sum);
    }
    return sum;
  }

  std::size_t Index(int i, int j) const {
    return static_cast<std::size_t>(j) * static_cast<std::size_t>(grid_width_) +
           static_cast<std::size_t>(i);
  }
  Tones& Grid(int i, int j) { return grid_[Index(i, j)]; }
  const Tones& Grid(int i, int j) const { return grid_[Index(i, j)]; }

  const Image16& faces_;
  const Subpixels& subpixels_;
  float bounced_;
  int grid_width_, grid_height_;
  std::vector<Patch> patches_;
  std::vector<Tones> grid_;
};

/// Adds the light that lens and chip scatter from all other pixels to each pixel.
void Scatter(const Device& device, double scale, int width, int height, std::vector<Tones>* light) {
  const int columns = (width - 1) / kScatterCell + 1, rows = (height - 1) / kScatterCell + 1;
  const auto count = static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows);
  std::vector<Tones> cells(count), thrown(count);
  const auto cell = [&](int u, int v) {
    return static_cast<std::size_t>(v / kScatterCell) * static_cast<std::size_t>(columns) +
           static_cast<std::size_t>(u / kScatterCell);
  };
  const auto pixel = [&](int u, int v) {
    return static_cast<std::size_t>(v) * static_cast<std::size_t>(width) +
           static_cast<std::size_t>(u);
  };
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) Add(1, (*light)[pixel(u, v)], &cells[cell(u, v)]);
  }
  // A density that falls exponentially with distance has the integral 2 pi reach^2.
  const double reach = device.scatter_reach * scale;
  const double density = device.scattered / (2 * M_PI * reach * reach);
  std::vector<float> kernel(count);
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < columns; ++x)
      kernel[cell(x * kScatterCell, y * kScatterCell)] =
          static_cast<float>(density * std::exp(-kScatterCell * std::hypot(x, y) / reach));
  }
  for (int v = 0; v < rows; ++v) {
    for (int u = 0; u < columns; ++u) {
      Tones& sum = thrown[cell(u * kScatterCell, v * kScatterCell)];
      for (int q = 0; q < rows; ++q) {
        for (int p = 0; p < columns; ++p) {
          Add(kernel[cell(std::abs(p - u) * kScatterCell, std::abs(q - v) * kScatterCell)],
              cells[cell(p * kScatterCell, q * kScatterCell)], &sum);
        }
      }
    }
  }
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) Add(1, thrown[cell(u, v)], &(*light)[pixel(u, v)]);
  }
}

}  // namespace

NoisyView TofPhysics(const TofModel& model, const NoiseInput& input, std::uint64_t device_seed,
                     RandomStream& random) {
  const Device device(RandomStream(device_seed, 0, "physics"));
  const RenderedView& view = input.view;
  const int width = view.depth.width(), height = view.depth.height();
  const double scale = width / kReferenceWidth;
  const Subpixels subpixels(input);
  std::vector<Tones> light;
  light.reserve(view.depth.size());
  {
    const LightField field(input, subpixels, device.bounced);
    for (int v = 0; v < height; ++v) {
      for (int u = 0; u < width; ++u) light.push_back(field.At(u, v));
    }
  }
  Scatter(device, scale, width, height, &light);

  NoisyView out{view.depth, view.labels};
  Image<std::uint8_t> keep(width, height, 1);
  for (std::size_t i = 0; i < view.depth.size(); ++i) {
    if (view.faces[i] == 0) continue;
    const double along = std::hypot(view.rays->rays[i].x(), view.rays->rays[i].y(), 1.0F);
    const double surface = view.depth[i] * along;
    const Tones shown = OfPath(1, 2 * surface);
    std::array<double, kFrequencies.size()> ranges{};
    double range = 0, weights = 0, least = 1;
    for (std::size_t k = 0; k < ranges.size(); ++k) {
      const double sigma = kShotNoise * std::sqrt(std::abs(light[i][k]) + kRoomLight);
      const Phasor sampled = light[i][k] + Phasor(static_cast<float>(random.Normal(0, sigma)),
                                                  static_cast<float>(random.Normal(0, sigma)));
      const double metres = kLightSpeed / (4 * M_PI * kFrequencies[k]);
      ranges[k] = surface + metres * std::arg(sampled * std::conj(shown[k]));
      const double weight = 1 / (metres * metres);
      range += weight * ranges[k];
      weights += weight;
      least = std::min(least, static_cast<double>(std::abs(sampled)));
    }
    range /= weights;
    if (least < device.least_amplitude || std::abs(ranges[1] - ranges[0]) > kMostDisagreement)
      keep[i] = 0;
    const int u = static_cast<int>(i) % width, v = static_cast<int>(i) / width;
    if (!subpixels.IsUniform(u, v) && std::abs(range - surface) > kFlying) out.labels[i] = 0;
    const double turns = 2 * range * kFrequencies[0] / kLightSpeed;
    range += device.offset + kPixelOffset * device.pixels.Normal(i) +
             device.wiggling * std::sin(8 * M_PI * turns + device.wiggling_phase);
    out.depth[i] = static_cast<float>(range / along);
  }
  if (model.hexagon) ClearOutsideHexagon(width, height, device.centre_u, &keep);
  RoundKept(keep, &out);
  return out;
}

}  // namespace volalign
