#include "infer/initial/side_patch.h"

#include <gtest/gtest.h>
#include <Eigen/Geometry>

#include <cmath>
#include <string>
#include <vector>

#include "core/base/random.h"
#include "core/geometry/procrustes.h"
#include "core/geometry/visibility.h"
#include "infer/initial/box_fit.h"
#include "infer/initial/sides_fix_pose.h"
#include "tests/core/base/pixels.h"
#include "tests/infer/initial/geometry_frames.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::side_patch_test {
namespace {

using namespace testing_infer;

const SidePatch* Largest(const std::vector<SidePatch>& evidence, int label) {
  for (const SidePatch& patch : evidence) {
    if (patch.label == label) return &patch;
  }
  return nullptr;
}

/// A single box seen at 45 deg: both faces are whole, so that centre, normal and area are known in
/// closed form.
class OneBox : public ::testing::Test {
 protected:
  OneBox()
      : structure(
            Structure::FromBoxes("one", {Box::FromMinMax("box", Eigen::Vector3d(-0.25, -0.3, -0.2),
                                                         Eigen::Vector3d(0.25, 0.3, 0.2))})),
        pose(RingPose(45, 2.0, 0.1, 90, Eigen::Vector3d::Zero())),
        rendered(Render(structure, Kinect(), pose)),
        view(MakeSensorView(rendered.depth, Kinect())) {}

  void ExpectExact(const std::vector<SidePatch>& evidence, double tolerance) {
    for (const std::string name : {"box/front", "box/right"}) {
      const int label = LabelOf(structure, name);
      const SidePatch* patch = Largest(evidence, label);
      ASSERT_NE(patch, nullptr) << name;
      const Side& side = structure.SideOfLabel(label);
      EXPECT_LT((pose * patch->centroid - side.centre).norm(), tolerance) << name;
      EXPECT_LT((pose.linear() * patch->normal - side.normal).norm(), tolerance) << name;
      const double area = 4 * side.half_u * side.half_v;
      EXPECT_NEAR(patch->area, area, 0.03 * area) << name;
    }
  }

  Structure structure;
  Pose pose;
  SyntheticView rendered;
  SensorView view;
};

TEST_F(OneBox, GivesCentreNormalAndAreaOfWholeFaces) {
  ExpectExact(CollectPatches(view, Certain(rendered.labels), structure), 0.003);
}

// Beside the axis a pixel covers more than on it.
TEST_F(OneBox, ThroughALensToo) {
  const Intrinsics lens = KinectWithLens();
  pose = RingPose(45, 2.4, 0.1, 90, Eigen::Vector3d(-0.75, 0, 0.75));
  rendered = Render(structure, lens, pose);
  view = MakeSensorView(rendered.depth, lens);
  const Eigen::Vector3d centre = pose.inverse() * Eigen::Vector3d::Zero();
  EXPECT_GT(centre.head<2>().norm() / centre.z(), 0.4);
  ExpectExact(CollectPatches(view, Certain(rendered.labels), structure), 0.005);
}

TEST_F(OneBox, AHandfulOfFarPixelsHasNoSay) {
  // Isolated and clustered background pixels with a side's label, metres behind it.
  LabelImage labels = rendered.labels;
  const auto front = static_cast<std::uint8_t>(LabelOf(structure, "box/front"));
  RandomStream random(3, 0, "far");
  int spoilt = 0;
  for (int i = 0; i < 400; ++i) {
    const int u = random.Below(320), v = random.Below(288);
    if (labels(u, v) == 0 && view.depth(u, v) > 3) {
      labels(u, v) = front;
      ++spoilt;
    }
  }
  for (const auto [u, v] : Pixels({290, 5}, {310, 15})) {
    labels(u, v) = front;
    if (view.depth(u, v) > 0) ++spoilt;
  }
  ASSERT_GT(spoilt, 100);
  ExpectExact(CollectPatches(view, Certain(labels), structure), 0.005);
}

TEST_F(OneBox, UnsurePixelsAreNotEvidence) {
  SegmentationResult segmentation = Certain(rendered.labels);
  for (float& c : segmentation.confidence) c = 0.49f;
  EXPECT_TRUE(CollectPatches(view, segmentation, structure).empty());
}

TEST(SidePatch, ALabelOnTwoSurfacesGivesBoth) {
  const Structure structure = PaperStructure();
  const Pose pose = RingPose(20);
  const auto rendered = Render(structure, Kinect(), pose);
  const SensorView view = MakeSensorView(rendered.depth, Kinect());
  LabelImage labels = rendered.labels;
  const int from = LabelOf(structure, "top/front"), to = LabelOf(structure, "bottom/front");
  for (std::uint8_t& label : labels) {
    if (label == from) label = static_cast<std::uint8_t>(to);
  }
  int patches = 0;
  bool near_top = false, near_bottom = false;
  for (const SidePatch& patch : CollectPatches(view, Certain(labels), structure)) {
    if (patch.label != to) continue;
    ++patches;
    const double height = (pose * patch.centroid).y();
    near_top = near_top || std::abs(height - structure.SideOfLabel(from).centre.y()) < 0.1;
    near_bottom = near_bottom || std::abs(height - structure.SideOfLabel(to).centre.y()) < 0.1;
  }
  EXPECT_EQ(patches, 2);
  EXPECT_TRUE(near_top);
  EXPECT_TRUE(near_bottom);
}

TEST(SidesFixPose, KnowsTheStructuresCollinearKeypoints) {
  const Structure structure = PaperStructure();
  const auto fixes = [&](const std::vector<std::string>& names) {
    return SidesFixPose(structure, LabelsOf(structure, names));
  };
  // Exactly collinear centres, of parallel sides.
  EXPECT_FALSE(fixes({"mid_bottom/front", "mid_top/front", "top/front"}));
  EXPECT_FALSE(fixes({"bottom/right", "mid_bottom/right", "mid_top/right"}));
  EXPECT_FALSE(fixes({"mid_bottom/front"}));
  EXPECT_FALSE(fixes({"mid_bottom/front", "mid_top/right"}));
  EXPECT_FALSE(fixes({}));
  // One side off the line.
  EXPECT_TRUE(fixes({"mid_bottom/front", "mid_top/front", "top/front", "bottom/front"}));
  EXPECT_TRUE(fixes({"mid_bottom/front", "mid_top/front", "top/right"}));
  EXPECT_TRUE(fixes({"bottom/right", "mid_bottom/front", "mid_top/up"}));
}

TEST(SidesFixPose, PlanesFixWhatKeypointsInALineDoNot) {
  const auto box = [](const char* name, const Eigen::Vector3d& min, const Eigen::Vector3d& max) {
    return Box::FromMinMax(name, min, max);
  };
  // Faces of three directions whose centres are (0, 0, 0), (0, 1, 0) and (0, 2, 0).
  const Structure mixed =
      Structure::FromBoxes("mixed", {box("a", {-0.5, -0.25, -0.25}, {0, 0.25, 0.25}),
                                     box("b", {-0.25, 0.75, -0.5}, {0.25, 1.25, 0}),
                                     box("c", {-0.25, 1.5, -0.25}, {0.25, 2, 0.25})});
  const std::vector<int> labels = LabelsOf(mixed, {"a/front", "b/right", "c/up"});
  std::vector<Eigen::Vector3d> centres;
  centres.reserve(labels.size());
  for (const int label : labels) centres.push_back(mixed.SideOfLabel(label).centre);
  ASSERT_LT((centres[1] - Eigen::Vector3d(0, 1, 0)).norm(), 1e-12);
  ASSERT_LT(SecondSingularValue(centres), 1e-9);
  EXPECT_TRUE(SidesFixPose(mixed, labels));
  EXPECT_FALSE(SidesFixPose(mixed, LabelsOf(mixed, {"a/front", "b/right"})));
}

Structure Stack() {
  return Structure::FromBoxes("stack", {Standing("low", {0.6, 0.3, 0.4}, {0, 0, 0}),
                                        Standing("high", {0.3, 0.4, 0.25}, {0.1, 0.3, -0.05})});
}

const Pose kTruth = RingPose(35, 1.9, 1.1, 20, {0, 0.3, 0});

/// Points on the sides that face the sensor, whatever hides them; `away`: along the normal, m.
std::vector<OrientedPoint> Surface(const Structure& structure, double away = 0) {
  std::vector<OrientedPoint> points;
  for (const Eigen::Vector3d& p : SampleExposedSurface(structure, 0.03)) {
    const Eigen::Vector3d& normal =
        structure.sides()[static_cast<std::size_t>(DistanceToSurface(structure, p).side)].normal;
    if (normal.dot(kTruth.translation() - p) > 0) {
      points.push_back({kTruth.inverse() * (p + away * normal),
                        kTruth.linear().transpose() * normal, 0.03 * 0.03});
    }
  }
  return points;
}

/// The structure moved, and turned about its middle.
Pose Moved(const Eigen::Vector3d& shift, const Eigen::Vector3d& turn) {
  const Eigen::Vector3d middle(0, 0.35, 0);
  Pose moved = Pose::Identity();
  moved.linear() = RotationExp(turn);
  moved.translation() = middle + shift - moved.linear() * middle;
  return moved * kTruth;
}

double Off(const Pose& pose) {
  const Eigen::Matrix4d off = (pose * kTruth.inverse()).matrix() - Eigen::Matrix4d::Identity();
  return off.cwiseAbs().maxCoeff();
}

TEST(FitToBoxes, BringsPointsOntoTheirSides) {
  RandomStream random(1, 0, "box fit");
  const auto draw = [&](double size) {
    return Eigen::Vector3d{random.Uniform(-size, size), random.Uniform(-size, size),
                           random.Uniform(-size, size)};
  };
  BoxFit fit;
  fit.steps = 30;
  fit.points = 5000;
  for (int k = 0; k < 10; ++k) {
    const Pose start = Moved(draw(0.03), draw(0.05));
    // The least-squares answer is the truth itself, but for the weak prior.
    EXPECT_LT(Off(FitToBoxes(Surface(Stack()), Stack(), fit, start)), 2e-4) << k;
  }
}

TEST(FitToBoxes, StaysAtTheTruth) {
  EXPECT_LT(Off(FitToBoxes(Surface(Stack()), Stack(), BoxFit(), kTruth)), 1e-9);
  // Nothing measured moves nothing.
  EXPECT_LT(Off(FitToBoxes({}, Stack(), BoxFit(), kTruth)), 1e-12);
}

// A third of the points lie 3 cm before their sides: an ordinary mean would be off by 1 cm.
TEST(FitToBoxes, IsRobust) {
  std::vector<OrientedPoint> points = Surface(Stack());
  const std::vector<OrientedPoint> before = Surface(Stack(), 0.03);
  for (std::size_t k = 0; k < points.size(); k += 3) points[k] = before[k];
  BoxFit fit;
  fit.steps = 30;
  fit.last_reach = 0.02;
  EXPECT_LT(Off(FitToBoxes(points, Stack(), fit, kTruth)), 1e-3);
}

TEST(FitToBoxes, LeavesOutWhatFacesElsewhereOrIsFar) {
  std::vector<OrientedPoint> points = Surface(Stack());
  const std::size_t own = points.size();
  for (std::size_t k = 0; k < own; ++k) {
    // On the same places, of surfaces that are turned by 60 deg; and 15 cm away.
    OrientedPoint turned = points[k], far = points[k];
    turned.normal = Eigen::AngleAxisd(M_PI / 3, turned.normal.unitOrthogonal()) * turned.normal;
    turned.p += 0.02 * points[k].normal;
    far.p += 0.15 * points[k].normal;
    points.push_back(turned);
    points.push_back(far);
  }
  BoxFit fit;
  fit.points = 10000;
  // Some of those that are turned face as a neighbouring side does and lie near it.
  EXPECT_LT(Off(FitToBoxes(points, Stack(), fit, kTruth)), 3e-3);
}

// One side, seen head on: it tells its distance and two turns, its border the place along it. Where
// the points end is no border, so that they may slide as long as they stay on the side.
TEST(FitToBoxes, ASidesBorderHoldsItsPoints) {
  const Structure cube =
      Structure::FromBoxes("cube", {Box::FromMinMax("c", {-0.2, 0, -0.2}, {0.2, 0.4, 0.2})});
  std::vector<OrientedPoint> points;
  for (int i = -10; i <= 10; ++i) {
    for (int j = 0; j <= 20; ++j) points.push_back({{0.2, 0.02 * j, 0.02 * i}, {1, 0, 0}, 4e-4});
  }
  BoxFit fit;
  fit.steps = 40;
  fit.points = 10000;
  const auto fitted = [&](const Eigen::Vector3d& shift) -> Eigen::Vector3d {
    return FitToBoxes(points, cube, fit, Pose(Eigen::Translation3d(shift))).translation();
  };
  EXPECT_LT(fitted({0.03, 0, 0}).norm(), 1e-3);
  EXPECT_LT(fitted({0, 0, 0.03}).norm(), 3e-3);
  EXPECT_LT(fitted({0, -0.03, 0}).norm(), 3e-3);
  // Half as wide, they are anywhere on it.
  std::vector<OrientedPoint> some;
  for (const OrientedPoint& point : points) {
    if (std::abs(point.p.z()) < 0.1) some.push_back(point);
  }
  const Pose slid = FitToBoxes(some, cube, fit, Pose(Eigen::Translation3d(0, 0, 0.03)));
  EXPECT_NEAR(slid.translation().z(), 0.03, 1e-3);
}

// The stack hovers 3 cm above the floor that is seen beside it. Its own sides are upright: nothing
// else tells its height.
TEST(FitToBoxes, TheFloorHoldsTheHeight) {
  const Structure cube =
      Structure::FromBoxes("cube", {Box::FromMinMax("c", {-0.2, 0, -0.2}, {0.2, 0.4, 0.2})});
  std::vector<OrientedPoint> points;
  for (int i = -8; i <= 8; ++i) {
    for (int j = 5; j <= 15; ++j) points.push_back({{0.2, 0.02 * j, 0.02 * i}, {1, 0, 0}, 4e-4});
  }
  for (int i = -20; i <= 20; ++i) {
    for (int j = -20; j <= 20; ++j) {
      if (std::max(std::abs(i), std::abs(j)) > 8)
        points.push_back({{0.04 * i, 0, 0.04 * j}, {0, 1, 0}, 16e-4});
    }
  }
  BoxFit fit;
  fit.steps = 30;
  fit.points = 10000;
  const Pose start(Eigen::Translation3d(0, 0.03, 0));
  EXPECT_NEAR(FitToBoxes(points, cube, fit, start).translation().y(), 0.03, 1e-3);
  fit.floor = true;
  EXPECT_NEAR(FitToBoxes(points, cube, fit, start).translation().y(), 0, 1e-3);
}

}  // namespace
}  // namespace volalign::side_patch_test
