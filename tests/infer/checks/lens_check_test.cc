#include "infer/checks/lens_check.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "tests/core/base/expect_error.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::lens_check_test {
namespace {

using namespace testing_infer;

Intrinsics WithDistortion(double k1, double k2) {
  Intrinsics intrinsics = Kinect();
  intrinsics.distortion = {k1, k2, 0, 0, 0};
  return intrinsics;
}

constexpr double kK1 = -0.08, kK2 = 0.02;

/// Two walls, 45 deg to the left and to the right, 2 m away, that a sensor with the lens `truth`
/// looks at and that its view has seen through `used`.
SensorPlanes Walls(const Intrinsics& truth, const Intrinsics& used) {
  SensorPlanes sensor{used, {}};
  for (const double side : {-1.0, 1.0}) {
    const Eigen::Vector3d normal = Eigen::Vector3d(side, 0, -1).normalized();
    LargePlane wall;
    for (int v = 8; v < truth.height; v += 16) {
      for (int u = 8; u < truth.width; u += 16) {
        if (side * (u - truth.cx) > 0) continue;
        const Eigen::Vector3d ray = RayThroughLens(truth, u, v).homogeneous();
        const double z = -2 / normal.dot(ray);
        wall.patches.push_back({z * RayThroughLens(used, u, v).homogeneous(), 1e-8});
      }
    }
    sensor.planes.push_back(wall);
  }
  return sensor;
}

/// One frame's lens, of which the capture gives the pinhole, as well known as `sigma` says.
LensSet Assumed(const LensChange& change, double sigma) {
  LensSet lenses;
  lenses.lenses.resize(1);
  lenses.lenses[0].prior_sigmas = {0.01, sigma, sigma};
  lenses.lenses[0].change = change;
  lenses.of_frame = PerFrame<std::size_t>(std::vector<std::vector<std::size_t>>{{0}});
  lenses.assumed = PerFrame<Intrinsics>({{Kinect()}});
  lenses.own_focal = PerFrame<double>(std::vector<std::vector<double>>{{0}});
  return lenses;
}

std::optional<Finding> Check(const SensorPlanes& planes, const LensSet& lenses) {
  return CheckLenses(PerFrame<SensorPlanes>({{planes}}), lenses, true)[{}];
}

TEST(CheckLenses, WallsThatLookBentMakeALensSuspect) {
  const SensorPlanes bent = Walls(WithDistortion(kK1, kK2), Kinect());
  const LensSet lenses = Assumed(LensChange::Zero(), 0.001);
  const std::optional<Finding> finding = Check(bent, lenses);
  ASSERT_TRUE(finding.has_value());
  EXPECT_EQ(finding->code, SensorCode::kLensSuspect);
  EXPECT_TRUE(Has(finding->hint, "leave the distortion out", "not along each ray"));
  const std::optional<Finding> fixed =
      CheckLenses(PerFrame<SensorPlanes>({{bent}}), lenses, false)[{}];
  ASSERT_TRUE(fixed.has_value());
  EXPECT_TRUE(Has(fixed->hint, "--estimate auto"));
  EXPECT_FALSE(Check(Walls(Kinect(), Kinect()), lenses).has_value());
}

TEST(CheckLenses, ALensThatHasBeenChangedAccordinglyIsTheRightOne) {
  const LensSet changed = Assumed({0, kK1, kK2}, 0.001);
  const Intrinsics truth = WithDistortion(kK1, kK2);
  EXPECT_FALSE(Check(Walls(truth, changed.Effective({})), changed).has_value());
  // What is bent through that lens is its fault.
  EXPECT_TRUE(Check(Walls(Kinect(), changed.Effective({})), changed).has_value());
}

TEST(CheckLenses, ALensThatMayBeSoIsNotSuspect) {
  const SensorPlanes bent = Walls(WithDistortion(kK1, kK2), Kinect());
  EXPECT_FALSE(Check(bent, Assumed(LensChange::Zero(), 0.1)).has_value());
}

TEST(CheckLenses, AFocalLengthBeyondWhatItsKindVaries) {
  // Its prior has 1 %.
  const SensorPlanes flat = Walls(Kinect(), Kinect());
  const std::optional<Finding> finding = Check(flat, Assumed({-0.05, 0, 0}, 0.1));
  ASSERT_TRUE(finding.has_value());
  EXPECT_EQ(finding->code, SensorCode::kIntrinsicsSuspect);
  EXPECT_TRUE(Has(finding->reason, "-4.9 %", "fx = 239.9", "1.0 % are usual"));
  for (const double sign : {1, -1}) {
    EXPECT_TRUE(Check(flat, Assumed({sign * 0.0255, 0, 0}, 0.1)).has_value());
    EXPECT_FALSE(Check(flat, Assumed({sign * 0.0245, 0, 0}, 0.1)).has_value());
  }
  // A sensor's own is part of it, and of what is usual; and by itself, beside others' of its kind.
  LensSet lenses = Assumed({0.02, 0, 0}, 0.1);
  lenses.lenses[0].own_focal_sigma = 0.01;
  for (const double own : {0.0145, 0.0165, -0.0245, -0.0255}) {
    lenses.own_focal[{}] = own;
    EXPECT_EQ(Check(flat, lenses).has_value(), own > 0.0155 || own < -0.025) << own;
  }
  const std::string reason = Check(flat, lenses)->reason;
  EXPECT_TRUE(Has(reason, "-2.5 % from those of others of its kind"));
}

}  // namespace
}  // namespace volalign::lens_check_test
