#include "infer/view/sensor_lens.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "core/lens.h"

namespace volalign {

namespace {

/// Standard deviations of the logarithm of the focal length, of k1 and of k2.
using Sigmas = std::array<double, kLensParameters>;

/// A calibration of this very lens. Two factory calibrations of Azure Kinects agree to 0.1 % of the
/// radius over the whole image.
constexpr Sigmas kGiven = {0.002, 0.004, 0.006};
/// Another of its kind. The focal length that goes without a distortion may be that of a pinhole
/// which fits the image best.
constexpr Sigmas kTypical = {0.01, 0.006, 0.01};
constexpr Sigmas kRectified = {0.003, 0.006, 0.01};
constexpr Sigmas kMild = {0.01, 0.03, 0.06};
constexpr Sigmas kUnknown = {0.01, 0.2, 0.15};
/// One that is unknown, where no plane looks bent: most sensors whose capture gives no distortion
/// rectify their images.
constexpr Sigmas kNoBend = {0.01, 0.015, 0.02};

/// The kinds of sensors whose lens is known by their names in the intrinsics pool; the first of
/// these that a name begins with counts.
struct LensKind {
  const char* prefix;
  std::array<double, 8> distortion;  // OpenCV's order: k1 k2 p1 p2 k3 k4 k5 k6
  Sigmas sigmas;
};
constexpr std::array<LensKind, 3> kKinds = {{
    // Microsoft's Azure-Kinect-Sensor-SDK, factory calibration in issue 1518.
    {"azure_kinect", {0.92185, 0.50040, 0, 0, 0.02836, 1.25842, 0.75181, 0.14419}, kTypical},
    // Public calibrations of the depth camera.
    {"kinect_v2", {0.09, -0.27, 0, 0, 0.10, 0, 0, 0}, kMild},
    // Its depth images are rectified.
    {"realsense", {}, kRectified},
}};

constexpr int kGridSteps = 8;  // of LargestShift, along each side of the image

// The inverse, on the plane z = 1.
constexpr int kNewtonSteps = 20;
constexpr double kConverged = 1e-9;
constexpr double kFolded = 0.05;  // determinant of the derivative, of which 1 is no distortion

Eigen::Vector3d AsVector(const Sigmas& sigmas) { return {sigmas[0], sigmas[1], sigmas[2]}; }

bool IsNone(const std::array<double, 8>& distortion) {
  return std::all_of(distortion.begin(), distortion.end(), [](double k) { return k == 0; });
}

}  // namespace

const char* ToString(LensSource source) {
  switch (source) {
    case LensSource::kGiven:
      return "given";
    case LensSource::kKind:
      return "kind";
    case LensSource::kRecognised:
      return "recognised";
    case LensSource::kEstimated:
      return "estimated";
  }
  return "";
}

std::vector<LensSource> AllOf(LensSource) {
  return {LensSource::kGiven, LensSource::kKind, LensSource::kRecognised, LensSource::kEstimated};
}

Intrinsics WithLensChange(Intrinsics intrinsics, const LensChange& change) {
  intrinsics.fx *= std::exp(change[0]);
  intrinsics.fy *= std::exp(change[0]);
  if (change[1] == 0 && change[2] == 0) return intrinsics;
  if (intrinsics.distortion.size() < 4) intrinsics.distortion.resize(4, 0.0);
  intrinsics.distortion[0] += change[1];
  intrinsics.distortion[1] += change[2];
  return intrinsics;
}

RayByLensMatrix RayByLens(const Intrinsics& intrinsics, const Eigen::Vector2d& ray) {
  const BentRay at = BendRay(intrinsics, ray);
  const double r2 = ray.squaredNorm();
  RayByLensMatrix by_change;
  by_change << at.bent, ray * (r2 / at.denominator), ray * (r2 * r2 / at.denominator);
  return -at.by_ray.inverse() * by_change;
}

Eigen::Vector2d SamePixelRay(const Intrinsics& from, const Intrinsics& to,
                             const Eigen::Vector2d& ray) {
  const Eigen::Vector2d pixel = ProjectRay(from, ray);
  const Eigen::Vector2d wanted((pixel.x() - to.cx) / to.fx, (pixel.y() - to.cy) / to.fy);
  Eigen::Vector2d found = ray;
  for (int i = 0; i < kNewtonSteps; ++i) {
    const BentRay at = BendRay(to, found);
    if (!(at.by_ray.determinant() > kFolded)) break;
    const Eigen::Vector2d step = at.by_ray.inverse() * (wanted - at.bent);
    found += step;
    if (step.norm() < kConverged) return found;
  }
  return Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN());
}

LensPrior PriorOfLens(const Intrinsics& given, const std::string& sensor) {
  if (!given.distortion.empty()) return {given.distortion, AsVector(kGiven)};
  for (const LensKind& kind : kKinds) {
    if (sensor.rfind(kind.prefix, 0) != 0) continue;
    if (IsNone(kind.distortion)) return {{}, AsVector(kind.sigmas), LensSource::kKind};
    return {
        {kind.distortion.begin(), kind.distortion.end()}, AsVector(kind.sigmas), LensSource::kKind};
  }
  return {{}, AsVector(kUnknown), LensSource::kGiven, true};
}

Eigen::Vector3d SigmasWithoutBend() { return AsVector(kNoBend); }

std::vector<LensPrior> TypicalLenses() {
  std::vector<LensPrior> typical;
  for (const LensKind& kind : kKinds) {
    if (IsNone(kind.distortion)) continue;
    typical.push_back({{kind.distortion.begin(), kind.distortion.end()},
                       AsVector(kind.sigmas),
                       LensSource::kRecognised});
  }
  return typical;
}

LensSet AssumeLenses(const std::vector<SensorFrame>& frames, bool per_sensor) {
  LensSet set;
  std::map<std::pair<std::string, bool>, int> shared;  // by kind and whether it is given
  std::map<std::string, int> own;                      // by the sensor's name
  for (const SensorFrame& frame : frames) {
    LensPrior prior = PriorOfLens(frame.intrinsics, frame.sensor);
    const auto next = static_cast<int>(set.lenses.size());
    const auto [entry, is_first] = own.emplace(frame.name, next);
    if (is_first && !per_sensor && !frame.sensor.empty()) {
      entry->second =
          shared.emplace(std::pair(frame.sensor, !frame.intrinsics.distortion.empty()), next)
              .first->second;
    }
    if (entry->second == next)
      set.lenses.push_back(
          {frame.sensor, prior.sigmas, LensChange::Zero(), {}, prior.source, prior.unknown});
    set.of_frame.push_back(entry->second);
    set.repeats.push_back(!is_first);
    set.assumed.push_back(frame.intrinsics);
    set.assumed.back().distortion = std::move(prior.distortion);
  }
  return set;
}

LensSet GivenLenses(const std::vector<SensorFrame>& frames) {
  LensSet set;
  std::map<std::string, int> own;  // by the sensor's name
  for (const SensorFrame& frame : frames) {
    const auto [entry, is_first] = own.emplace(frame.name, static_cast<int>(set.lenses.size()));
    set.of_frame.push_back(entry->second);
    set.repeats.push_back(!is_first);
    set.assumed.push_back(frame.intrinsics);
    if (!is_first) continue;
    set.lenses.emplace_back();
    set.lenses.back().sensor = frame.sensor;
  }
  return set;
}

LensSet OfFrames(const LensSet& lenses, std::size_t first, std::size_t count) {
  const auto part = [&](const auto& all) {
    const auto begin = all.begin() + static_cast<std::ptrdiff_t>(first);
    return std::decay_t<decltype(all)>(begin, begin + static_cast<std::ptrdiff_t>(count));
  };
  return {lenses.lenses, part(lenses.of_frame), part(lenses.assumed), part(lenses.repeats)};
}

LensEstimate EstimateLens(const LensEvidence& evidence, const Eigen::Vector3d& prior_sigmas) {
  // In units of the prior, so that a standard deviation of zero is no division.
  const Eigen::Matrix3d scale = prior_sigmas.asDiagonal();
  const Eigen::Matrix3d inverse =
      (scale * evidence.information * scale + Eigen::Matrix3d::Identity()).inverse();
  LensEstimate estimate;
  estimate.covariance = scale * inverse * scale;
  estimate.change = estimate.covariance * evidence.moment;
  return estimate;
}

double LogBayesFactor(const LensEstimate& estimate, const Eigen::Vector3d& prior_sigmas) {
  if (!(prior_sigmas.minCoeff() > 0)) return 0;
  const Eigen::Vector3d inverse = prior_sigmas.cwiseInverse();
  const Eigen::Matrix3d covariance =
      inverse.asDiagonal() * estimate.covariance * inverse.asDiagonal();
  const Eigen::Vector3d change = inverse.cwiseProduct(estimate.change);
  return 0.5 * (change.dot(covariance.inverse() * change) + std::log(covariance.determinant()));
}

double LargestShift(const Intrinsics& a, const Intrinsics& b) {
  double largest = 0;
  for (int i = 0; i <= kGridSteps; ++i) {
    for (int j = 0; j <= kGridSteps; ++j) {
      const Eigen::Vector2d ray((a.width * static_cast<double>(i) / kGridSteps - a.cx) / a.fx,
                                (a.height * static_cast<double>(j) / kGridSteps - a.cy) / a.fy);
      largest = std::max(largest, (ProjectRay(a, ray) - ProjectRay(b, ray)).norm());
    }
  }
  return largest;
}

}  // namespace volalign
