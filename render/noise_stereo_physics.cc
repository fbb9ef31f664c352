#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "core/base/noise_fields.h"
#include "render/noise_models.h"
#include "render/subpixels.h"

namespace volalign {
namespace {

constexpr int kWindow = 4;          // px to each side: 9x9, as Intel's presets of the D415
constexpr int kMostDecimation = 4;  // native pixels along each side of an output pixel
/// For 1 to 4 native pixels along each side of an output pixel: the column that is matched in each
/// row. Each column is matched once, so the mean is near the middle.
constexpr std::array<std::array<int, kMostDecimation>, kMostDecimation> kMatched = {
    {{0}, {1, 0}, {1, 0, 2}, {1, 3, 0, 2}}};
constexpr int kSearch = 3;  // px about the disparities within the window
// A match is taken if no other one, more than a pixel away, is nearly as good, and if the right
// picture shows the same surface there.
constexpr float kUniqueness = 0.95F;
constexpr float kLeftRight = 1;  // px
// The picture: a surface's texture, with grains of these sizes, a projector's dots, and the
// imager's noise. Brightness is about 0.5.
constexpr std::array<float, 3> kGrains = {0.004F, 0.012F, 0.04F};  // m
constexpr float kTexture = 0.25F, kPlain = 0.02F;                  // of texture 1 and 0
constexpr float kDotPitch = 6, kDotRadius = 1.3F;                  // native px
constexpr float kDots = 0.35F;                                     // at 1 m; falls with 1/z
constexpr float kImagerNoise = 0.012F;
// Remaining errors of the pair's calibration (standard deviations, native px). Rows miss each other
// by an offset and a slope, and are shifted by a polynomial of the second order.
constexpr double kRowError = 0.15, kShiftError = 0.06;

/// A number in [0, 1) from three whole numbers.
float Hash(std::int32_t x, std::int32_t y, std::uint32_t salt) {
  std::uint64_t bits = static_cast<std::uint64_t>(static_cast<std::uint32_t>(x)) << 32 |
                       static_cast<std::uint32_t>(y);
  bits ^= salt * 0xD6E8FEB86659FD93ULL;
  bits = (bits ^ (bits >> 30)) * 0xBF58476D1CE4E5B9ULL;
  bits = (bits ^ (bits >> 27)) * 0x94D049BB133111EBULL;
  return static_cast<float>((bits ^ (bits >> 31)) >> 40) * 0x1.0p-24F;
}

/// Interpolates hashes at the corners of unit cells; zero mean.
float ValueNoise(float x, float y, std::uint32_t salt) {
  const float fx = std::floor(x), fy = std::floor(y);
  const auto i = static_cast<std::int32_t>(fx), j = static_cast<std::int32_t>(fy);
  const auto smooth = [](float t) { return t * t * (3 - 2 * t); };
  const float s = smooth(x - fx), t = smooth(y - fy);
  return (1 - t) * ((1 - s) * Hash(i, j, salt) + s * Hash(i + 1, j, salt)) +
         t * ((1 - s) * Hash(i, j + 1, salt) + s * Hash(i + 1, j + 1, salt)) - 0.5F;
}

/// One dot at a random place in each cell.
float DotPattern(float x, float y) {
  const auto i = static_cast<std::int32_t>(std::floor(x / kDotPitch));
  const auto j = static_cast<std::int32_t>(std::floor(y / kDotPitch));
  float sum = 0;
  for (std::int32_t q = j - 1; q <= j + 1; ++q) {
    for (std::int32_t p = i - 1; p <= i + 1; ++p) {
      const float dx = x - kDotPitch * (static_cast<float>(p) + Hash(p, q, 1));
      const float dy = y - kDotPitch * (static_cast<float>(q) + Hash(p, q, 2));
      sum += std::exp(-(dx * dx + dy * dy) / (2 * kDotRadius * kDotRadius));
    }
  }
  return sum;
}

/// Remaining errors of a pair's calibration; x and y are -1 to 1 over the picture.
struct Misalignment {
  std::array<double, 3> rows{};
  std::array<double, 6> shift{};

  explicit Misalignment(RandomStream random) {
    for (double& a : rows) a = random.Normal(0, kRowError);
    for (double& a : shift) a = random.Normal(0, kShiftError);
  }
  double Rows(double x, double y) const { return rows[0] + rows[1] * x + rows[2] * y; }
  double Shift(double x, double y) const {
    return shift[0] + shift[1] * x + shift[2] * y + shift[3] * x * x + shift[4] * x * y +
           shift[5] * y * y;
  }
};

/// The pair's pictures at the native resolution, with their surfaces.
class Pair {
 public:
  Pair(const StereoModel& model, const NoiseInput& input, const Misalignment& misalignment,
       RandomStream& random)
      : input_(input),
        subpixels_(input),
        factor_(
            std::clamp(static_cast<int>(std::lround(model.native_width / input.view.depth.width())),
                       1, kMostDecimation)),
        width_(factor_ * input.view.depth.width()),
        height_(factor_ * input.view.depth.height()),
        baseline_(static_cast<float>(model.focal_baseline * width_ / model.native_width)),
        faces_(width_, height_, -1),
        disparity_(width_, height_),
        right_disparity_(width_, height_),
        left_(width_, height_),
        right_(width_, height_) {
    for (int y = 0; y < height_; ++y) {
      for (int x = 0; x < width_; ++x) DrawLeft(x, y);
    }
    for (int y = 0; y < height_; ++y) DrawRight(y, misalignment);
    for (Image<float>* picture : {&left_, &right_}) {
      const PixelRandom noise(random);
      for (std::size_t i = 0; i < picture->size(); ++i)
        (*picture)[i] += kImagerNoise * noise.Normal(i);
    }
  }

  int factor() const { return factor_; }
  float baseline() const { return baseline_; }
  /// The surface at a native pixel of the left picture; 0 and -1 if there is none.
  float Disparity(int x, int y) const { return disparity_(x, y); }
  int Face(int x, int y) const { return faces_(x, y); }
  const Subpixels& subpixels() const { return subpixels_; }

  /// The disparity, px, at which the window about (x, y) of the left picture fits the right one
  /// best; 0 for no match.
  float Match(int x, int y, float largest) const {
    if (x < kWindow || y < kWindow || x + kWindow >= width_ || y + kWindow >= height_) return 0;
    candidates_.clear();
    for (int q = y - kWindow; q <= y + kWindow; q += kWindow) {
      for (int p = x - kWindow; p <= x + kWindow; p += kWindow) {
        const float d = disparity_(p, q);
        if (d == 0) continue;
        const int middle = static_cast<int>(std::lround(d));
        for (int c = middle - kSearch; c <= middle + kSearch; ++c) candidates_.push_back(c);
      }
    }
    std::sort(candidates_.begin(), candidates_.end());
    candidates_.erase(std::unique(candidates_.begin(), candidates_.end()), candidates_.end());
    int best = 0;
    float least = std::numeric_limits<float>::infinity();
    costs_.clear();
    for (const int d : candidates_) {
      const float cost = Cost(x, y, d);
      costs_.push_back(cost);
      if (cost < least) {
        least = cost;
        best = d;
      }
    }
    if (!std::isfinite(least) || best < 1 || static_cast<float>(best) > largest) return 0;
    for (std::size_t i = 0; i < costs_.size(); ++i) {
      if (std::abs(candidates_[i] - best) > 1 && kUniqueness * costs_[i] < least) return 0;
    }
    const float before = Cost(x, y, best - 1), after = Cost(x, y, best + 1);
    const float bend = before - 2 * least + after;
    if (!(std::isfinite(bend) && bend > 0)) return 0;
    const float d = static_cast<float>(best) + 0.5F * (before - after) / bend;
    const auto at = static_cast<int>(std::lround(static_cast<float>(x) - d));
    if (at < 0 || std::abs(right_disparity_(at, y) - d) > kLeftRight) return 0;
    return d;
  }

 private:
  Eigen::Vector3f Ray(double x, double y) const {
    return subpixels_.Ray((x + 0.5) / factor_ - 0.5, (y + 0.5) / factor_ - 0.5);
  }

  void DrawLeft(int x, int y) {
    const Eigen::Vector3f ray = Ray(x, y);
    const int u = x / factor_, v = y / factor_;
    const int face =
        subpixels_.IsUniform(u, v) ? input_.view.faces(u, v) - 1 : subpixels_.FaceAlong(ray, u, v);
    if (face < 0) return;
    faces_(x, y) = face;
    const float z = subpixels_.Depth(face, ray);
    disparity_(x, y) = baseline_ / z;
    left_(x, y) = Brightness(face, z * ray);
  }

  /// Projects the left picture's rows into the right picture, run by run of one face; the nearest
  /// surface counts. Parts that the left camera does not see have their own texture.
  void DrawRight(int y, const Misalignment& misalignment) {
    for (int x = 0; x < width_; ++x)
      right_(x, y) = 0.5F + kTexture * ValueNoise(0.3F * static_cast<float>(x),
                                                  0.3F * static_cast<float>(y), 77);
    const double v = 2.0 * y / height_ - 1;
    for (int begin = 0, end = 0; begin < width_; begin = end) {
      const int face = faces_(begin, y);
      while (end < width_ && faces_(end, y) == face) ++end;
      if (face < 0) continue;
      const auto from =
          static_cast<int>(std::floor(static_cast<float>(begin) - disparity_(begin, y)));
      const auto to =
          static_cast<int>(std::ceil(static_cast<float>(end - 1) - disparity_(end - 1, y)));
      for (int x = std::max(from, 0); x <= std::min(to, width_ - 1); ++x) {
        const double u = 2.0 * x / width_ - 1;
        const double shifted = x - misalignment.Shift(u, v), row = y - misalignment.Rows(u, v);
        // The left picture's place of x: disparities change slowly along a row.
        double source = shifted + Along(face, shifted, row);
        for (int step = 0; step < 2; ++step) source = shifted + Along(face, source, row);
        if (source < begin - 0.5 || source > end - 0.5) continue;
        const Eigen::Vector3f ray = Ray(source, row);
        const float z = subpixels_.Depth(face, ray), d = baseline_ / z;
        if (d <= right_disparity_(x, y)) continue;
        right_disparity_(x, y) = d;
        right_(x, y) = Brightness(face, z * ray);
      }
    }
  }
  double Along(int face, double x, double y) const {
    return baseline_ / subpixels_.Depth(face, Ray(x, y));
  }

  float Brightness(int face, const Eigen::Vector3f& point) const {
    const SeenFace& seen = subpixels_.face(face);
    const Eigen::Vector3f from_corner = point - seen.corner;
    const float s = from_corner.dot(seen.along_u.normalized());
    const float t = from_corner.dot(seen.normal.cross(seen.along_u).normalized());
    const float contrast = kPlain + kTexture * seen.object->texture;
    float grey = 0.5F;
    for (std::size_t k = 0; k < kGrains.size(); ++k) {
      grey += contrast *
              ValueNoise(s / kGrains[k], t / kGrains[k],
                         static_cast<std::uint32_t>(16 * face) + 8 + static_cast<std::uint32_t>(k));
    }
    // The projector is half a baseline beside the left camera.
    const auto focal = static_cast<float>(factor_ * input_.intrinsics.fx);
    const float shift = 0.5F * baseline_ / point.z();
    return grey +
           kDots / point.z() *
               DotPattern(focal * point.x() / point.z() - shift, focal * point.y() / point.z());
  }

  /// Mean absolute difference of two windows.
  float Cost(int x, int y, int d) const {
    const int at = x - d;
    if (at < kWindow || at + kWindow >= width_) return std::numeric_limits<float>::infinity();
    float sum = 0;
    for (int q = y - kWindow; q <= y + kWindow; ++q) {
      const float *const a = &left_(x - kWindow, q), *const b = &right_(at - kWindow, q);
      for (int i = 0; i <= 2 * kWindow; ++i) sum += std::abs(a[i] - b[i]);
    }
    return sum;
  }

  const NoiseInput& input_;
  const Subpixels subpixels_;
  int factor_, width_, height_;
  float baseline_;  // times the focal length, px m
  Image<int> faces_;
  Image<float> disparity_, right_disparity_, left_, right_;
  mutable std::vector<int> candidates_;
  mutable std::vector<float> costs_;
};

}  // namespace

NoisyView StereoPhysics(const StereoModel& model, const NoiseInput& input,
                        std::uint64_t device_seed, RandomStream& random) {
  const Misalignment misalignment(RandomStream(device_seed, 0, "physics"));
  const Pair pair(model, input, misalignment, random);
  const int width = input.view.depth.width(), height = input.view.depth.height();
  const auto largest =
      static_cast<float>(model.largest_disparity * pair.factor() * width / model.native_width);
  const int factor = pair.factor();
  NoisyView out{DepthImage(width, height), LabelImage(width, height)};
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      // An output pixel is the mean of native ones (librealsense, "post-processing filters").
      float sum = 0;
      int count = 0;
      std::uint8_t label = 0;
      float nearest = std::numeric_limits<float>::infinity();
      for (int row = 0; row < factor; ++row) {
        const int y = factor * v + row;
        const int x = factor * u +
                      kMatched[static_cast<std::size_t>(factor) - 1][static_cast<std::size_t>(row)];
        const float d = pair.Match(x, y, largest);
        if (d == 0) continue;
        sum += pair.baseline() / d;
        ++count;
        // The surface in the window that was matched.
        for (int q = y - kWindow; q <= y + kWindow; q += kWindow) {
          for (int p = x - kWindow; p <= x + kWindow; p += kWindow) {
            const float off = std::abs(pair.Disparity(p, q) - d);
            if (pair.Face(p, q) < 0 || off >= nearest) continue;
            nearest = off;
            label = pair.subpixels().face(pair.Face(p, q)).label;
          }
        }
      }
      if (count == 0) continue;
      out.depth(u, v) = sum / static_cast<float>(count);
      out.labels(u, v) = label;
    }
  }
  RoundKept(Image<std::uint8_t>(width, height, 1), &out);
  return out;
}

}  // namespace volalign
