#pragma once

// The possible lenses of a sensor.

#include <Eigen/Core>
#include <cmath>
#include <string>
#include <vector>

#include "core/base/odds.h"
#include "core/config/config_word.h"
#include "core/geometry/camera.h"
#include "infer/view/frames.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// The difference of a lens from its assumed intrinsics: logarithm of the factor on both focal
/// lengths, and additions to the coefficients k1 and k2.
using LensChange = Eigen::Vector3d;
inline constexpr int kLensParameters = LensChange::SizeAtCompileTime;

/// The intrinsics of the changed lens.
Intrinsics WithLensChange(Intrinsics intrinsics, const LensChange& change);

using RayByLensMatrix = Eigen::Matrix<double, 2, kLensParameters>;
/// Derivative of a fixed pixel's ray (x/z, y/z) with respect to the lens change, at these
/// intrinsics and this ray.
RayByLensMatrix RayByLens(const Intrinsics& intrinsics, const Eigen::Vector2d& ray);

/// The second camera's ray for the pixel of the first camera's `ray`; NaN if the second model folds
/// over before it.
Eigen::Vector2d SamePixelRay(const Intrinsics& from, const Intrinsics& to,
                             const Eigen::Vector2d& ray);

/// The source of a lens: the capture, the sensor's kind, planes that show a known kind's lens, or
/// the capture's own estimate.
enum class LensSource { kGiven, kKind, kRecognised, kEstimated };
constexpr Words<LensSource, 4> WordsOf(LensSource) {
  return {{{"given", LensSource::kGiven},
           {"kind", LensSource::kKind},
           {"recognised", LensSource::kRecognised},
           {"estimated", LensSource::kEstimated}}};
}

/// Prior of a lens.
struct LensPrior {
  std::vector<double> distortion;  ///< the most probable one, as Intrinsics::distortion
  Eigen::Vector3d sigmas;          ///< standard deviations of the LensChange from there
  LensSource source = LensSource::kGiven;
  bool unknown = false;  ///< nothing is known about the distortion
};

/// The prior of a frame's lens. It is narrow around the distortion that the capture gives. Without
/// one, the sensor's kind decides: the typical curve of an Azure Kinect or Kinect v2, none for
/// sensors with rectified images (RealSense). An unknown kind has none, with wide standard
/// deviations.
LensPrior PriorOfLens(const Intrinsics& given, const std::string& sensor);

/// A measurement of a lens change, as the quadratic part of its log-likelihood:
/// -0.5 c^T information c + c^T moment for a change c from the assumed intrinsics.
struct LensEvidence {
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  Eigen::Vector3d moment = Eigen::Vector3d::Zero();

  LensEvidence& operator+=(const LensEvidence& other) {
    information += other.information;
    moment += other.moment;
    return *this;
  }
};

/// The most probable change under a prior of these standard deviations about zero, with its
/// covariance.
struct LensEstimate {
  LensChange change = LensChange::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  /// Natural logarithm of the measurement's probability, over all changes weighted by the prior. A
  /// constant that depends on the measurement alone is left out.
  double log_evidence = 0;
};
LensEstimate EstimateLens(const LensEvidence& evidence, const Eigen::Vector3d& prior_sigmas);

/// How much more probable the measurement is if the lens may differ from the assumed one: natural
/// logarithm of the Bayes factor, for a Gaussian posterior.
double LogBayesFactor(const LensEstimate& estimate, const Eigen::Vector3d& prior_sigmas);

/// Natural logarithm of the odds above which another lens is believed.
inline const double kBelievedLens = std::log(kModelOdds);

/// A lens of one sensor, or of several that share it.
struct SensorLens {
  std::string sensor;  ///< kind; empty: unknown
  Eigen::Vector3d prior_sigmas = Eigen::Vector3d::Zero();
  LensChange change = LensChange::Zero();  ///< the best that is known, from the assumed intrinsics
  LensEvidence evidence;                   ///< of large planes, linear at the change
  LensSource source = LensSource::kGiven;  ///< of what is assumed
  /// If several sensors share it: standard deviation of the logarithm of each one's own factor on
  /// its focal length.
  double own_focal_sigma = 0;
  /// Neither the capture nor the kind gives its distortion.
  bool unknown = false;
  /// Planes contradict its given lens. It stays so, and the planes are not used.
  bool contradicted = false;
};

/// The lenses of all frames.
struct LensSet {
  std::vector<SensorLens> lenses;
  PerFrame<std::size_t> of_frame;  ///< index of each frame's lens
  PerFrame<Intrinsics> assumed;    ///< with its prior's distortion
  /// An earlier frame is of the same sensor. Its planes are measured once: the others have the same
  /// errors.
  PerFrame<char> repeats;
  /// Logarithm of the own factor of each frame's sensor on the focal length of its lens.
  PerFrame<double> own_focal;

  const SensorLens& Of(FrameId id) const { return lenses[of_frame[id]]; }
  /// The change of its lens with the sensor's own factor.
  LensChange ChangeOf(FrameId id) const {
    return Of(id).change + own_focal[id] * LensChange::UnitX();
  }
  /// The intrinsics with this change.
  Intrinsics Effective(FrameId id) const { return WithLensChange(assumed[id], ChangeOf(id)); }
};

/// Every frame seen through its lens.
PerFrame<SensorView> LookThrough(const CaptureSet& input, const LensSet& lenses, int threads);

/// The same, from `views` through the lenses `before`.
PerFrame<SensorView> LookThrough(const CaptureSet& input, const LensSet& lenses,
                                 PerFrame<SensorView> views, const LensSet& before, int threads);

/// Standard deviations of a lens of which only one thing is known: the images show no bend.
Eigen::Vector3d SigmasWithoutBend();

/// The typical lenses of known kinds: what an unknown one may be.
std::vector<LensPrior> TypicalLenses();

/// Sensors of one known kind share a lens, unless `per_sensor`. The capture has to say equally much
/// of them: a distortion, or none, and focal lengths (as shares of the width) within 1 %. Every
/// other sensor has its own.
LensSet AssumeLenses(const CaptureSet& input, bool per_sensor);

/// The lenses as the capture gives them, all known, so none is estimated.
LensSet GivenLenses(const CaptureSet& input);

/// The largest distance, px, between the places where two sets of intrinsics of one image size show
/// the same directions. On a grid over the image of `a`, where that has rays.
double LargestShift(const Intrinsics& a, const Intrinsics& b);
/// The largest over all frames.
double LargestShift(const LensSet& a, const LensSet& b);

}  // namespace volalign
