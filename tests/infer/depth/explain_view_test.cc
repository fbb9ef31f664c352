#include "infer/depth/explain_view.h"

#include <gtest/gtest.h>

#include <cmath>

#include "infer/depth/explain_ray.h"
#include "infer/depth/measured_view.h"
#include "infer/depth/share_odds.h"
#include "tests/core/base/pixels.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::explain_view_test {
namespace {

using namespace testing_infer;

/// A box whose face at 1 m covers the left half of Coarse's view.
Structure LeftBox() {
  return Structure::FromBoxes(
      "box", {Box::FromMinMax("b", Eigen::Vector3d(-1, -1, 1), Eigen::Vector3d(0, 1, 2))});
}

/// Columns of Coarse's view, each of 10 pixels, in cells: the solid angle of a pixel is the
/// integral of cos^3 over the square that it covers of the plane z = 1.
double CellsOfColumns(int from, int to) {
  const double rad = ErrorsOf("").smooth_rad;
  double cells = 0;
  for (const auto [u, v] : Pixels({from, 0}, {to + 1, 10})) {
    const double x = (u - 9.5) / 40, y = (v - 4.5) / 40;
    cells += 1 / (40.0 * 40 * rad * rad) / std::pow(std::sqrt(1 + x * x + y * y), 3);
  }
  return cells;
}
double CellsOfColumn(int u) { return CellsOfColumns(u, u); }

struct Seen {
  DepthImage depth = DepthImage(20, 10, 3.0f);
  SegmentationResult segmentation = Certain(LabelImage(20, 10, 0));

  Seen() {
    const Structure box = LeftBox();
    const auto front = static_cast<std::uint8_t>(LabelOf(box, "b/left"));
    const auto hidden = static_cast<std::uint8_t>(LabelOf(box, "b/right"));
    for (int v = 0; v < 10; ++v) {
      for (int u = 3; u < 9; ++u) depth(u, v) = 1.005f;
      depth(0, v) = 0;
      depth(1, v) = 0.5f;  // before it
      depth(2, v) = 1.5f;  // behind it, far from every side
      depth(9, v) = 1.2f;  // behind the face, but 1.5 cm from the side x = 0
      for (const int u : {0, 1, 3, 4, 6, 8, 15}) segmentation.labels(u, v) = front;
      segmentation.labels(5, v) = hidden;
      segmentation.confidence(6, v) = 0.3f;
    }
  }
};

TEST(ExplainView, CountsCells) {
  const Seen seen;
  const ViewExplanation view = ExplainView(MakeSensorView(seen.depth, Coarse()), &seen.segmentation,
                                           LeftBox(), Pose::Identity(), 0.004);
  // Within 1 %, as each point may be something else to that extent.
  EXPECT_NEAR(view.of(Cause::kMissing), CellsOfColumn(0), 1e-6);
  EXPECT_NEAR(view.of(Cause::kBefore), CellsOfColumn(1), 0.01);
  EXPECT_NEAR(view.of(Cause::kBehind), CellsOfColumn(2), 0.01);
  EXPECT_NEAR(view.of(Cause::kSurface), CellsOfColumns(3, 9), 0.01);
  EXPECT_NEAR(view.behind_share(), CellsOfColumn(2) / CellsOfColumns(2, 9), 0.01);
  // Labelled and with depth: 1, 3, 4, 5, 8, 15; on the side that the label names: 3, 4, 8.
  const double so = CellsOfColumns(3, 4) + CellsOfColumn(8);
  EXPECT_NEAR(view.named_so, so, 0.01);
  EXPECT_NEAR(view.labelled_on, so + CellsOfColumn(5), 0.01);
  EXPECT_NEAR(view.named_so + view.named_otherwise,
              so + CellsOfColumn(1) + CellsOfColumn(5) + CellsOfColumn(15), 0.01);
}

TEST(ExplainView, ManyRaysSayNoMoreThanFew) {
  const Seen seen;
  const SensorView view = MakeSensorView(seen.depth, Coarse());
  const auto explain = [&](const SensorView& of) {
    return ExplainView(of, nullptr, LeftBox(), Pose::Identity(), 0.004);
  };
  const ViewExplanation all = explain(view), few = explain(Decimate(view, 2));
  double cells = 0, of_few = 0;
  for (std::size_t k = 0; k < kCauses; ++k) {
    cells += all.causes[k];
    of_few += few.causes[k];
  }
  EXPECT_NEAR(of_few, cells, 0.02 * cells);
  EXPECT_EQ(all.named_so + all.named_otherwise, 0);
  EXPECT_EQ(all.LogOddsByLabels(), 0);
}

// The paper's stack from 2 m: its pose explains the view, one that is a quarter turn and a box off
// does not, and what hides half of it or is missing changes nothing.
TEST(ExplainView, TellsRightFromWrongWhateverIsHidden) {
  const Structure structure = PaperStructure();
  const Pose pose = RingPose(30);
  const SyntheticView rendered = Render(structure, Kinect(), pose, {true, 3});
  SensorView view = MakeSensorView(rendered.depth, Kinect());
  const auto log_odds = [&](const Pose& at) {
    return ExplainView(view, nullptr, structure, at, 0.004).LogOddsByDepth();
  };
  const Pose turned = Pose(Eigen::Translation3d(0, 0.4, 0) *
                           Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitY())) *
                      pose;
  EXPECT_GT(log_odds(pose), 1);
  EXPECT_LT(log_odds(turned), -std::log(100.0));
  for (const auto [u, v] : Pixels(view)) {
    if (v % 2 == 0) view.depth(u, v) = 0;
    if (v > view.height() / 2 && view.depth(u, v) > 0) view.depth(u, v) = 0.8f;
  }
  EXPECT_GT(log_odds(pose), 0);
}

/// 10 mm of white noise at every depth.
DepthErrorModel TenMillimetres() {
  DepthErrorModel errors;
  errors.white_m = 0.01;
  errors.smooth_rad = 0.1;
  return errors;
}

double Sum(const CauseShares& share) { return share[0] + share[1] + share[2] + share[3]; }

// Bayes' rule with the densities written out: at 2 m, sigma 12.5 mm of the sensor's 10 and the
// surface's 7.5, 30 mm off; 2 of 1,000 rays measure what is before it, or behind it.
TEST(Explain, IsTheProbabilityOfEachCause) {
  const double normal = std::exp(-0.5 * 2.4 * 2.4) / (0.0125 * std::sqrt(2 * M_PI));
  const double before = 0.002 / 2, behind = 0.002 * std::exp(-0.03 / 2) / 2;
  const CauseShares near = Explain({2, 0.0075}, {1.97, 0.03}, TenMillimetres());
  EXPECT_NEAR(near[0], normal / (normal + before), 1e-12);
  EXPECT_NEAR(near[1], before / (normal + before), 1e-12);
  EXPECT_EQ(near[2], 0);
  const CauseShares far = Explain({2, 0.0075}, {2.03, 0.03}, TenMillimetres());
  EXPECT_NEAR(far[0], normal / (normal + behind), 1e-12);
  EXPECT_NEAR(far[2], behind / (normal + behind), 1e-12);
  EXPECT_EQ(far[1], 0);
}

TEST(Explain, SharesAddUpToOneAndTheSurfaceGivesWayWithDistance) {
  double before = 1;
  for (double off = 0; off < 0.2; off += 0.005) {
    const CauseShares share = Explain({3, 0.01}, {3 + off, off}, TenMillimetres());
    EXPECT_NEAR(Sum(share), 1, 1e-12) << off;
    EXPECT_LE(share[0], before) << off;
    before = share[0];
  }
  EXPECT_LT(before, 1e-9);
}

TEST(Explain, AGrazingRayIsJudgedByThePointsDistance) {
  // 30 cm deeper along the ray, but 5 mm off the surface.
  EXPECT_GT(Explain({2, 0.01}, {2.3, 0.005}, TenMillimetres())[0], 0.99);
}

TEST(Explain, NoDepthIsMissingAndFarOffIsNotTheSurface) {
  EXPECT_EQ(Explain({2, 0.01}, {0, 0}, TenMillimetres()), (CauseShares{0, 0, 0, 1}));
  EXPECT_EQ(Explain({2, 0}, {1, 1}, TenMillimetres()), (CauseShares{0, 1, 0, 0}));
  // Where no density differs from 0, a frame in other units.
  EXPECT_EQ(Explain({2, 0}, {9000, 8998}, TenMillimetres()), (CauseShares{0, 0, 1, 0}));
}

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
  Intrinsics intrinsics{640, 480, 400, 400, 319.5, 239.5, {-0.3, 0, 0, 0}};
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
  for (const auto [u, v] : Pixels(10, 10)) view.depth(u, v) = 2;
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

// And the mean of s^n (1 - s)^m over shares s, for counts that are not whole, too.
TEST(ShareModel, IsTheMeanOverAllShares) {
  const ShareModel model{3, 2};  // density proportional to s^2 (1 - s), which is 12 times that
  const double cells_for = 4.3, cells_against = 1.7;
  constexpr int kSteps = 200000;
  double mean = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double s = (i + 0.5) / kSteps;
    mean += 12 * s * s * (1 - s) * std::pow(s, cells_for) * std::pow(1 - s, cells_against) / kSteps;
  }
  EXPECT_NEAR(model.LogProbability(cells_for, cells_against), std::log(mean), 1e-8);
}

TEST(ShareOdds, NothingSeenSaysNothingAndMoreSaysMore) {
  const ShareOdds odds{{50, 0.5}, {3, 1}};
  EXPECT_EQ(odds.LogOdds(0, 0), 0);
  EXPECT_GT(odds.LogOdds(10, 0), 0);
  EXPECT_GT(odds.LogOdds(20, 0), odds.LogOdds(10, 0));
  EXPECT_LT(odds.LogOdds(7, 3), 0);
  EXPECT_LT(odds.LogOdds(14, 6), odds.LogOdds(7, 3));
}

}  // namespace
}  // namespace volalign::explain_view_test
