#include "infer/checks/pose_quality.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/infer/view/synthetic.h"

namespace volalign::pose_quality_test {
namespace {

using namespace testing_infer;

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
    EXPECT_NEAR(fit.rms_m, off, 1e-6);
    EXPECT_EQ(fit.inlier_share, 1);
  }
  const HeadOn far(0.4 - 0.05);
  const SurfaceFit fit = FitToSurface(far.view, far.labels.labels, far.structure, far.pose);
  EXPECT_NEAR(fit.rms_m, 0.05, 1e-6);
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
  EXPECT_NEAR(fit.rms_m, std::sqrt(120.0 * 0.02 * 0.02 / 140), 1e-6);
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
}  // namespace volalign::pose_quality_test
