#include "infer/lens/sensor_lens.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "core/geometry/lens.h"
#include "core/geometry/sensor_kind.h"

namespace volalign {

namespace {

// Standard deviations of the logarithm of the focal length, of k1 and of k2.

/// A calibration of the device itself. Two factory calibrations of Azure Kinects agree to 0.1 % of
/// the radius over the whole image.
const Eigen::Vector3d kGiven(0.002, 0.004, 0.006);
const Eigen::Vector3d kUnknown(0.01, 0.2, 0.15);
/// An unknown lens, if no plane looks bent. Most sensors whose capture gives no distortion rectify
/// their images.
const Eigen::Vector3d kNoBend(0.01, 0.015, 0.02);

constexpr int kGridSteps = 8;  // of LargestShift, along each side of the image

// The inverse, on the plane z = 1.
constexpr int kNewtonSteps = 20;
constexpr double kConverged = 1e-9;
constexpr double kFolded = 0.05;  // determinant of the derivative, of which 1 is no distortion

/// With the distortion of intrinsics, empty if there is none.
LensPrior PriorOf(const TypicalLens& lens, LensSource source) {
  return {lens.distortion, Eigen::Vector3d(lens.sigmas.data()), source};
}

/// See SensorLens::own_focal_sigma. A kind without a known lens has that of a calibration.
double OwnFocalSigma(const std::string& sensor) {
  const SensorKind* kind = FindSensorKind(sensor);
  return kind != nullptr && kind->lens ? kind->lens->own_focal_sigma : kGiven[0];
}

/// Does a capture say equally much of two lenses of one kind? Recorded calibrations of devices of
/// one kind differ by up to 0.9 %. The first Kinect, calibrated by its owners, differs by 3 %
/// (configs/intrinsics.yaml).
bool SaidAlike(const SensorFrame& a, const SensorFrame& b) {
  const auto log_focal = [](const SensorFrame& frame) {
    return std::log(frame.intrinsics.fx / frame.intrinsics.width);
  };
  return a.sensor == b.sensor &&
         a.intrinsics.distortion.empty() == b.intrinsics.distortion.empty() &&
         std::abs(log_focal(a) - log_focal(b)) <= kUnknown[0];
}

}  // namespace

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
  if (!given.distortion.empty()) return {given.distortion, kGiven};
  const SensorKind* kind = FindSensorKind(sensor);
  if (kind != nullptr && kind->lens) return PriorOf(*kind->lens, LensSource::kKind);
  return {{}, kUnknown, LensSource::kGiven, true};
}

Eigen::Vector3d SigmasWithoutBend() { return kNoBend; }

std::vector<LensPrior> TypicalLenses() {
  std::vector<LensPrior> typical;
  for (const SensorKind& kind : SensorKinds()) {
    if (!kind.lens || kind.lens->rectified()) continue;
    const LensPrior prior = PriorOf(*kind.lens, LensSource::kRecognised);
    const bool known = std::any_of(typical.begin(), typical.end(), [&](const LensPrior& other) {
      return other.distortion == prior.distortion;
    });
    if (!known) typical.push_back(prior);
  }
  return typical;
}

PerFrame<SensorView> LookThrough(const CaptureSet& input, const LensSet& lenses, int threads) {
  return MapFrames(lenses.of_frame, threads,
                   [&](FrameId id) { return MakeSensorView(input[id], lenses.Effective(id)); });
}

PerFrame<SensorView> LookThrough(const CaptureSet& input, const LensSet& lenses,
                                 PerFrame<SensorView> views, const LensSet& before, int threads) {
  return MapFrames(lenses.of_frame, threads, [&](FrameId id) {
    const Intrinsics intrinsics = lenses.Effective(id);
    return intrinsics == before.Effective(id) ? std::move(views[id])
                                              : MakeSensorView(input[id], intrinsics);
  });
}

LensSet AssumeLenses(const CaptureSet& input, bool per_sensor) {
  LensSet set = GivenLenses(input);
  set.lenses.clear();
  std::vector<std::pair<const SensorFrame*, std::size_t>> shared;  // the first frame of each lens
  std::vector<std::size_t> of_sensor;
  for (const FrameId id : input.sensor_of.Ids()) {
    const SensorFrame& frame = input[id];
    LensPrior prior = PriorOfLens(frame.intrinsics, frame.sensor);
    if (!set.repeats[id]) {
      const std::size_t next = set.lenses.size();
      of_sensor.push_back(next);
      if (!per_sensor && !frame.sensor.empty()) {
        const auto alike = std::find_if(shared.begin(), shared.end(), [&](const auto& first) {
          return SaidAlike(*first.first, frame);
        });
        if (alike != shared.end()) {
          of_sensor.back() = alike->second;
          set.lenses[alike->second].own_focal_sigma = OwnFocalSigma(frame.sensor);
        } else {
          shared.emplace_back(&frame, next);
        }
      }
      if (of_sensor.back() == next)
        set.lenses.push_back(
            {frame.sensor, prior.sigmas, LensChange::Zero(), {}, prior.source, 0, prior.unknown});
    }
    set.of_frame[id] = of_sensor[input.sensor_of[id]];
    set.assumed[id].distortion = std::move(prior.distortion);
  }
  return set;
}

LensSet GivenLenses(const CaptureSet& input) {
  const auto of_frames = [&](const auto& of) { return MapFrames(input.sensor_of, 1, of); };
  LensSet set{{},
              input.sensor_of,
              of_frames([&](FrameId id) { return input[id].intrinsics; }),
              of_frames([](FrameId) { return char{1}; }),
              of_frames([](FrameId) { return 0.0; })};
  for (const FrameId id : input.sensor_of.Ids()) {
    if (input.sensor_of[id] < set.lenses.size()) continue;
    set.lenses.emplace_back();
    set.lenses.back().sensor = input[id].sensor;
    set.repeats[id] = 0;
  }
  return set;
}

LensEstimate EstimateLens(const LensEvidence& evidence, const Eigen::Vector3d& prior_sigmas) {
  // In units of the prior, to allow a standard deviation of zero.
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
  Intrinsics straight = a;
  straight.distortion.clear();
  double largest = 0;
  for (int i = 0; i <= kGridSteps; ++i) {
    for (int j = 0; j <= kGridSteps; ++j) {
      const Eigen::Vector2d pixel(a.width * static_cast<double>(i) / kGridSteps,
                                  a.height * static_cast<double>(j) / kGridSteps);
      const Eigen::Vector2d ray =
          SamePixelRay(straight, a, {(pixel.x() - a.cx) / a.fx, (pixel.y() - a.cy) / a.fy});
      if (ray.allFinite()) largest = std::max(largest, (pixel - ProjectRay(b, ray)).norm());
    }
  }
  return largest;
}

double LargestShift(const LensSet& a, const LensSet& b) {
  double largest = 0;
  for (const FrameId id : a.of_frame.Ids())
    largest = std::max(largest, LargestShift(a.Effective(id), b.Effective(id)));
  return largest;
}

}  // namespace volalign
