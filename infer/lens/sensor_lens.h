#pragma once

// What a sensor's lens may be, beyond what a capture says about it.

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

/// How a lens differs from its assumed intrinsics: logarithm of the factor on both focal lengths,
/// and what is added to the coefficients k1 and k2.
using LensChange = Eigen::Vector3d;
inline constexpr int kLensParameters = LensChange::SizeAtCompileTime;

/// The intrinsics of the changed lens.
Intrinsics WithLensChange(Intrinsics intrinsics, const LensChange& change);

using RayByLensMatrix = Eigen::Matrix<double, 2, kLensParameters>;
/// Derivative of the ray (x/z, y/z) that a fixed pixel has by the lens's change, at these
/// intrinsics and the pixel's ray.
RayByLensMatrix RayByLens(const Intrinsics& intrinsics, const Eigen::Vector2d& ray);

/// The ray that the second camera has for the pixel of the first one's `ray`; NaN where its model
/// folds over before.
Eigen::Vector2d SamePixelRay(const Intrinsics& from, const Intrinsics& to,
                             const Eigen::Vector2d& ray);

/// Where a lens comes from: the capture; what sensors of its kind have; planes, which show that it
/// is like that of a known kind; or an estimate of the capture's own.
enum class LensSource { kGiven, kKind, kRecognised, kEstimated };
constexpr Words<LensSource, 4> WordsOf(LensSource) {
  return {{{"given", LensSource::kGiven},
           {"kind", LensSource::kKind},
           {"recognised", LensSource::kRecognised},
           {"estimated", LensSource::kEstimated}}};
}

/// What is known about a lens before anything is measured.
struct LensPrior {
  std::vector<double> distortion;  ///< the most probable one, as Intrinsics::distortion
  Eigen::Vector3d sigmas;          ///< standard deviations of the LensChange from there
  LensSource source = LensSource::kGiven;
  bool unknown = false;  ///< nothing is known about the distortion
};

/// Of a frame: narrow around the distortion that the capture gives. Where it gives none, what is
/// known of the sensor's kind: the typical curve of an Azure Kinect or Kinect v2, none for sensors
/// whose images are rectified (RealSense), and for an unknown kind none, with wide standard
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
  /// Natural logarithm of the measurement's probability, all changes being weighed by the prior,
  /// but for a constant that depends on the measurement alone.
  double log_evidence = 0;
};
LensEstimate EstimateLens(const LensEvidence& evidence, const Eigen::Vector3d& prior_sigmas);

/// How much more probable what was measured is when the lens may differ from the one assumed than
/// when it is that one: natural logarithm of the Bayes factor, for a Gaussian posterior.
double LogBayesFactor(const LensEstimate& estimate, const Eigen::Vector3d& prior_sigmas);

/// Natural logarithm of the odds from which on another lens is believed.
inline const double kBelievedLens = std::log(kModelOdds);

/// A lens that several sensors share, or a single one's.
struct SensorLens {
  std::string sensor;  ///< kind; empty: unknown
  Eigen::Vector3d prior_sigmas = Eigen::Vector3d::Zero();
  LensChange change = LensChange::Zero();  ///< the best that is known, from the assumed intrinsics
  LensEvidence evidence;                   ///< of large planes, linear at the change
  LensSource source = LensSource::kGiven;  ///< of what is assumed
  /// Where several sensors share it: standard deviation of the logarithm of each one's own factor
  /// on its focal length.
  double own_focal_sigma = 0;
  /// Neither what the capture says nor the kind tells its distortion.
  bool unknown = false;
  /// Planes contradict what was said about it: it stays so, and they have no say.
  bool contradicted = false;
};

/// The lenses of all frames.
struct LensSet {
  std::vector<SensorLens> lenses;
  PerFrame<std::size_t> of_frame;  ///< index of each frame's lens
  PerFrame<Intrinsics> assumed;    ///< with its prior's distortion
  /// An earlier frame is of the same sensor. Its planes are measured once, as they are the same
  /// with the same errors.
  PerFrame<char> repeats;
  /// Logarithm of each frame's sensor's own factor on the focal length of its lens.
  PerFrame<double> own_focal;

  const SensorLens& Of(FrameId id) const { return lenses[of_frame[id]]; }
  /// Of its lens and its own.
  LensChange ChangeOf(FrameId id) const {
    return Of(id).change + own_focal[id] * LensChange::UnitX();
  }
  /// With this change.
  Intrinsics Effective(FrameId id) const { return WithLensChange(assumed[id], ChangeOf(id)); }
};

/// Every frame seen through its lens.
PerFrame<SensorView> LookThrough(const CaptureSet& capture, const LensSet& lenses, int threads);

/// The same, `views` being what is seen through the lenses `before`.
PerFrame<SensorView> LookThrough(const CaptureSet& capture, const LensSet& lenses,
                                 PerFrame<SensorView> views, const LensSet& before, int threads);

/// Standard deviations of a lens of which nothing is known but that the images show no bend.
Eigen::Vector3d SigmasWithoutBend();

/// The lenses that are known as the typical ones of some kind: what an unknown one may be.
std::vector<LensPrior> TypicalLenses();

/// Sensors of one known kind share a lens, unless `per_sensor`, where the capture says equally much
/// of them: a distortion, or none, and focal lengths (as shares of the width) within 1 %. Every
/// other one has its own.
LensSet AssumeLenses(const CaptureSet& capture, bool per_sensor);

/// The lenses as the capture gives them, all known: what is not to be estimated.
LensSet GivenLenses(const CaptureSet& capture);

/// The largest distance, px, between where two sets of intrinsics of one image size show the same
/// directions, on a grid over the image of `a`, where that has rays.
double LargestShift(const Intrinsics& a, const Intrinsics& b);
/// Of all frames.
double LargestShift(const LensSet& a, const LensSet& b);

}  // namespace volalign
