#include "infer/depth/measured_view.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/infer/view/synthetic.h"

namespace volalign::measured_view_test {
namespace {

using testing_infer::Coarse;

constexpr float kWall = 3;       // m
constexpr double kSigma = 0.03;  // m

constexpr double kAlmost = 0.02;  // what lies on a surface may be before or behind it to 1 %

/// A cube far behind the sensors, which they do not see.
Structure Elsewhere() {
  return Structure::FromBoxes("cube", {Box::FromMinMax("c", {0, 0, -20}, {0.4, 0.4, -19.6})});
}

/// What looks straight at a wall: 20 x 10 pixels, 75 mm apart there, 1.5 m x 0.75 m.
SensorView Wall(float distance = kWall) {
  Intrinsics intrinsics = Coarse();
  intrinsics.fx = intrinsics.fy = distance / 0.075;
  return MakeSensorView(DepthImage(20, 10, distance), intrinsics);
}

/// This sensor moved.
Pose By(double x, double z = 0) { return Pose(Eigen::Translation3d(x, 0, z)); }

MeasuredView Measured(const SensorView& view) { return {view, Elsewhere(), {Pose::Identity()}}; }

double Sum(const CauseShares& causes) { return causes[0] + causes[1] + causes[2] + causes[3]; }

// Of 20 columns, those that the other one sees, too, up to the pixel beyond its last ray: points
// beside its picture count nothing. Columns beside the middle are up to 8 % smaller.
TEST(MeasuredView, ComparesWhatBothSee) {
  const MeasuredView here = Measured(Wall()), there = Measured(Wall());
  const double all = Sum(here.Explain(there, By(0), kSigma));
  for (int columns = 0; columns < 24; ++columns) {
    const CauseShares causes = here.Explain(there, By(0.074 * columns), kSigma);
    EXPECT_NEAR(causes[0], all * std::max(0, std::min(20, 21 - columns)) / 20.0, 0.03 * all)
        << columns;
    EXPECT_NEAR(causes[0], Sum(causes), kAlmost * Sum(causes)) << columns;
  }
}

// A lens whose model folds before the corners: the first pixels of the picture have no ray, and
// their neighbours' pitch is not that of the others.
TEST(MeasuredView, PixelsWithoutARayAreNoPartOfThePicture) {
  Intrinsics intrinsics;
  intrinsics.width = 640;
  intrinsics.height = 480;
  intrinsics.fx = intrinsics.fy = 400;
  intrinsics.cx = 319.5;
  intrinsics.cy = 239.5;
  intrinsics.distortion = {-0.3, 0, 0, 0};
  const SensorView view = MakeSensorView(DepthImage(640, 480, kWall), intrinsics);
  ASSERT_EQ(view.ray_areas(0, 0), 0);
  const MeasuredView here = Measured(view);
  const CauseShares same = here.Explain(Measured(view), By(0), kSigma);
  EXPECT_GT(same[0], 10);
  EXPECT_NEAR(same[0], Sum(same), kAlmost * Sum(same));
  EXPECT_EQ(Sum(here.Explain(Measured(view), By(20), kSigma)), 0) << "beside the picture";
}

TEST(MeasuredView, PointsBeforeTheOthersSurfaceAreSeenThrough) {
  const MeasuredView here = Measured(Wall());
  const double all = Sum(here.Explain(Measured(Wall()), By(0), kSigma));
  for (const double nearer : {-1.0, -0.3, 0.0, 0.3, 1.0}) {
    const CauseShares causes = here.Explain(Measured(Wall()), By(0, -nearer), kSigma);
    EXPECT_NEAR(causes[nearer == 0  ? 0
                       : nearer < 0 ? 1
                                    : 2],
                Sum(causes), kAlmost * Sum(causes))
        << nearer;
    EXPECT_GT(Sum(causes), 0.5 * all) << nearer;
    if (nearer > 0) {
      EXPECT_LT(LogOddsOfPairs(causes), -1) << nearer;
    } else {
      EXPECT_GT(LogOddsOfPairs(causes), 0) << "what hides something tells nothing";
    }
  }
}

TEST(MeasuredView, APointBetweenTheDepthsOfAnEdgeIsNotSeenThrough) {
  SensorView edge = Wall();
  for (int v = 0; v < 10; ++v) {
    for (int u = 0; u < 20; u += 2) edge.depth(u, v) = 2;
  }
  SensorView between = Wall();
  for (float& z : between.depth) z = 2.5f;
  const CauseShares causes = Measured(edge).Explain(Measured(between), By(0), kSigma);
  EXPECT_NEAR(causes[0], Sum(causes), kAlmost * Sum(causes));
}

// A slab before the wall's left half, whichever of two poses it is at.
TEST(MeasuredView, LeavesOutTheStructureAtAllPoses) {
  SensorView view = Wall();
  for (int v = 0; v < 10; ++v) {
    for (int u = 0; u < 10; ++u) view.depth(u, v) = 2;
  }
  // Its front, 2 m away, reaches from x = -0.6 to the axis; at 2 m a pixel is 50 mm wide.
  const Structure structure =
      Structure::FromBoxes("slab", {Box::FromMinMax("s", {-0.6, -0.4, 2}, {0, 0.4, 2.1})});
  const MeasuredView whole = Measured(Wall());
  const CauseShares all = whole.Explain({view, structure, {By(10)}}, By(0), kSigma);
  const CauseShares without = whole.Explain({view, structure, {By(10), By(0)}}, By(0), kSigma);
  EXPECT_NEAR(all[2] / Sum(all), 0.5, 0.01);
  EXPECT_NEAR(without[0], Sum(without), kAlmost * Sum(without));
}

TEST(ExplainPair, CountsACellOnceWhicheverIsFirst) {
  const MeasuredView near = Measured(Wall()), far = Measured(Wall(kWall + 1));
  const CauseShares one = ExplainPair(near, far, By(0, -1), kSigma);
  const CauseShares other = ExplainPair(far, near, By(0, 1), kSigma);
  for (std::size_t k = 0; k < kCauses; ++k) EXPECT_NEAR(one[k], other[k], 1e-9) << k;
  const MeasuredView here = Measured(Wall());
  EXPECT_NEAR(Sum(ExplainPair(here, near, By(0), kSigma)), Sum(here.Explain(near, By(0), kSigma)),
              1e-9);
}

TEST(ExplainPair, NothingMeasuredSaysNothing) {
  SensorView empty = Wall();
  empty.depth = DepthImage(20, 10);
  const CauseShares causes = ExplainPair(Measured(empty), Measured(Wall()), By(0), kSigma);
  EXPECT_EQ(causes[0] + causes[1] + causes[2], 0);
  EXPECT_EQ(LogOddsOfPairs(causes), 0);
}

}  // namespace
}  // namespace volalign::measured_view_test
