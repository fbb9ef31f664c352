#include "infer/checks/depth_checks.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "infer/checks/lens_check.h"
#include "infer/checks/pose_quality.h"
#include "tests/core/base/expect_error.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::depth_checks_test {
namespace {

/// Every pixel at its own depth, from `nearest` to `farthest`.
SensorFrame Ramp(const std::string& name, float nearest, float farthest) {
  SensorFrame frame;
  frame.name = name;
  frame.intrinsics = testing_infer::Coarse();
  frame.depth = DepthImage(20, 10);
  for (std::size_t i = 0; i < frame.depth.size(); ++i)
    frame.depth[i] = nearest + (farthest - nearest) * static_cast<float>(i) / 199;
  return frame;
}

std::vector<DepthFinding> Check(const std::vector<SensorFrame>& frames) {
  std::vector<SensorView> views;
  for (const SensorFrame& frame : frames) views.push_back(MakeSensorView(frame, frame.intrinsics));
  return CheckDepths(frames, views);
}

TEST(DepthChecks, CountsPixelsWithDepth) {
  SensorFrame frame = Ramp("A", 1, 4);
  for (std::size_t i = 0; i < frame.depth.size(); ++i) frame.depth[i] *= i < 2;
  EXPECT_FALSE(Check({frame}).front().failure.has_value());  // 2 of 200: 1 %
  frame.depth[0] = 0;
  const DepthFinding finding = Check({frame}).front();
  ASSERT_TRUE(finding.failure.has_value());
  EXPECT_EQ(finding.failure->code, SensorCode::kNoDepth);
  EXPECT_TRUE(Has(finding.failure->reason, "0.5 %"));
}

TEST(DepthChecks, GivesTheRangeOfAWrongUnit) {
  struct Case {
    float factor;
    const char* words;
  };
  // A room of 1 to 4 m, read in another unit.
  for (const Case& c :
       {Case{1000, "313 to 5015 times too large"}, Case{10, "3.1 to 50 times too large"},
        Case{0.1f, "2.0 to 32 times too small"}, Case{0.001f, "199 to 3190 times too small"}}) {
    const DepthFinding finding = Check({Ramp("A", c.factor, 4 * c.factor)}).front();
    ASSERT_TRUE(finding.failure.has_value()) << c.factor;
    EXPECT_EQ(finding.failure->code, SensorCode::kWrongUnits);
    EXPECT_TRUE(Has(finding.failure->reason, c.words));
  }
}

/// 400 of 1,000 pixels have this value, the others those of a room.
DepthImage WithStandIn(float value) {
  DepthImage depth(100, 10);
  for (std::size_t i = 0; i < depth.size(); ++i)
    depth[i] = i % 5 < 2 ? value : 1 + 0.003f * static_cast<float>(i);
  return depth;
}

TEST(DropStandIns, OfAnyValueBeyondARoom) {
  for (const float value : {65.535f, 13.107f, 0.001f, 20.0f}) {
    DepthImage depth = WithStandIn(value);
    const DepthImage before = depth;
    DropStandIns(&depth);
    for (std::size_t i = 0; i < depth.size(); ++i)
      ASSERT_EQ(depth[i], i % 5 < 2 ? 0 : before[i]) << value;
  }
}

TEST(DropStandIns, NotOfASurface) {
  // Within a room; or one of many depths of a wall in a hall, or of depths in a wrong unit.
  DepthImage wall = WithStandIn(2.5f), hall = WithStandIn(12), unit = wall;
  for (std::size_t i = 0; i < wall.size(); ++i) {
    if (i % 5 == 2) hall[i] = 12.1f;
    unit[i] = 200 + static_cast<float>(i % 10);
  }
  for (const DepthImage& before : {wall, hall, unit}) {
    DepthImage depth = before;
    DropStandIns(&depth);
    EXPECT_TRUE(depth == before);
  }
}

TEST(DepthChecks, ANearObjectInARoomIsNoWrongUnit) {
  // A tenth of the pixels beyond 0.9 m is a background.
  SensorFrame frame = Ramp("A", 0.5f, 0.6f);
  for (std::size_t i = 180; i < 200; ++i) frame.depth[i] = 3;
  EXPECT_FALSE(Check({frame}).front().failure.has_value());
}

TEST(DepthChecks, TheFirstOfTwoEqualMapsStaysAndBothNameTheOther) {
  const std::vector<DepthFinding> findings =
      Check({Ramp("A", 1, 4), Ramp("B", 1, 3), Ramp("C", 1, 4)});
  EXPECT_FALSE(findings[0].failure.has_value());
  EXPECT_EQ(findings[0].same_depth_as, "C");
  EXPECT_FALSE(findings[1].failure.has_value());
  EXPECT_EQ(findings[1].same_depth_as, "");
  ASSERT_TRUE(findings[2].failure.has_value());
  EXPECT_EQ(findings[2].failure->code, SensorCode::kDuplicateDepth);
  EXPECT_EQ(findings[2].same_depth_as, "A");
}

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

/// A wall 1 m in front of a sensor at `distance` from the front face (x = 0.275) of the box at the
/// bottom, looking at its middle: every pixel within the face by 5 cm or more.
struct HeadOn {
  Structure structure = PaperStructure();
  Intrinsics intrinsics = Coarse();
  Pose pose = LookAt(Eigen::Vector3d(0.275 + 0.4, -0.6075, 0), Eigen::Vector3d(0, -0.6075, 0), 0);
  SensorView view;
  SegmentationResult labels;

  explicit HeadOn(double measured) {
    intrinsics.fx = intrinsics.fy = 100;  // 8 x 4 cm of the face at 0.4 m
    const DepthImage depth(20, 10, static_cast<float>(measured));
    view = MakeSensorView(depth, intrinsics);
    labels =
        Certain(LabelImage(20, 10, static_cast<std::uint8_t>(LabelOf(structure, "bottom/front"))));
  }
};

TEST(FitToSurface, MeasuresADistanceThatIsKnown) {
  for (const double off : {0.0, 0.01, 0.0299}) {
    const HeadOn scene(0.4 + off);
    const SurfaceFit fit =
        FitToSurface(scene.view, scene.labels.labels, scene.structure, scene.pose);
    EXPECT_EQ(fit.points, 200);
    EXPECT_NEAR(fit.rms_to_structure_m, off, 1e-6);
    EXPECT_EQ(fit.inlier_share, 1);
  }
  const HeadOn far(0.4 - 0.05);
  const SurfaceFit fit = FitToSurface(far.view, far.labels.labels, far.structure, far.pose);
  EXPECT_NEAR(fit.rms_to_structure_m, 0.05, 1e-6);
  EXPECT_EQ(fit.inlier_share, 0);
}

TEST(FitToSurface, LeavesOutWhatIsFarOffAndWhatHasNoLabelOrDepth) {
  HeadOn scene(0.42);
  for (int u = 0; u < 20; ++u) {
    scene.view.depth(u, 0) = 0.2f;  // 20 cm in front: a point, but not of the RMS
    scene.view.depth(u, 1) = 0;     // nothing measured
    scene.labels.labels(u, 2) = 0;  // background
    scene.view.depth(u, 3) = 0.4f;  // on the face
  }
  const SurfaceFit fit = FitToSurface(scene.view, scene.labels.labels, scene.structure, scene.pose);
  EXPECT_EQ(fit.points, 160);
  EXPECT_NEAR(fit.rms_to_structure_m, std::sqrt(120.0 * 0.02 * 0.02 / 140), 1e-6);
  EXPECT_NEAR(fit.inlier_share, 140.0 / 160, 1e-12);
}

TEST(CompareWithSurface, OfPointsAtAKnownDistance) {
  const Structure structure = PaperStructure();
  // On the front face of the bottom box, which nothing covers, and 4 mm in front of it.
  std::vector<Eigen::Vector3d> points;
  points.reserve(20);
  for (int i = 0; i < 20; ++i) points.emplace_back(0.275 + 0.004, -0.6 + 0.005 * i, 0.008 * i);
  const std::optional<SetDistances> distances = CompareWithSurface(points, structure);
  ASSERT_TRUE(distances.has_value());
  EXPECT_NEAR(distances->d1, 0.004, 1e-9);
  EXPECT_GT(distances->d2, 0.5);  // most of the surface was not seen
  EXPECT_FALSE(CompareWithSurface({Eigen::Vector3d(5, 5, 5)}, structure).has_value());
}

}  // namespace
}  // namespace volalign::depth_checks_test
