#include "infer/initial/same_pose.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "tests/infer/view/synthetic.h"

namespace volalign::same_pose_test {
namespace {

/// The structure moved by that much along x, and turned about its vertical, as the sensor sees it.
Pose Moved(const Pose& pose, double metres, double deg) {
  return Eigen::Translation3d(metres, 0, 0) *
         Eigen::AngleAxisd(deg * M_PI / 180, Eigen::Vector3d::UnitY()) * pose;
}

Structure Cube(double edge) {
  return Structure::FromBoxes(
      "cube", {Box::FromMinMax("cube", {-edge / 2, 0, -edge / 2}, {edge / 2, edge, edge / 2})});
}

TEST(SamePose, FollowsFromTheSmallestEdge) {
  const Pose pose = testing_infer::RingPose(30);
  struct Case {
    double edge, same, other;
  };
  // Half an edge; not under 3 cm, which is what two estimates differ by, nor over 20.
  for (const Case& c : {Case{0.1, 0.049, 0.051}, Case{0.3, 0.149, 0.151}, Case{0.02, 0.029, 0.031},
                        Case{2, 0.199, 0.201}}) {
    EXPECT_TRUE(SamePose(Cube(c.edge), pose, Moved(pose, c.same, 0))) << c.edge;
    EXPECT_FALSE(SamePose(Cube(c.edge), pose, Moved(pose, -c.other, 0))) << c.edge;
  }
  // A corner is 0.707 edges from the axis of the turn and moves by twice the sine of half of it.
  EXPECT_TRUE(SamePose(Cube(0.3), pose, Moved(pose, 0, 41)));
  EXPECT_FALSE(SamePose(Cube(0.3), pose, Moved(pose, 0, 42)));
}

TEST(SamePose, StepsOfASmallStackAreNone) {
  // A fifth of the paper's: its boxes are 8 cm high.
  std::vector<Box> boxes = testing_infer::PaperStructure().boxes();
  for (Box& box : boxes) {
    box.size /= 5;
    box.structure_from_box.translation() /= 5;
  }
  const Pose pose = testing_infer::RingPose(30, 0.8, 0.3);
  EXPECT_FALSE(SamePose(Structure::FromBoxes("small", boxes), pose,
                        Eigen::Translation3d(0, 0.08, 0) * pose));
}

TEST(SamePose, NoNumberIsNoPose) {
  Pose pose = Pose::Identity();
  pose.translation().x() = std::nan("");
  EXPECT_FALSE(SamePose(Cube(1), pose, pose));
}

}  // namespace
}  // namespace volalign::same_pose_test
