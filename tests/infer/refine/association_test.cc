#include "infer/refine/association.h"

#include <gtest/gtest.h>

#include "tests/infer/refine/points_and_observations.h"

namespace volalign::refine_internal::association_test {
namespace {

/// 20 x 10 cm about the origin, facing up.
Side Table() {
  Side side;
  side.centre.setZero();
  side.axis_u = Eigen::Vector3d::UnitZ();
  side.axis_v = Eigen::Vector3d::UnitX();
  side.normal = Eigen::Vector3d::UnitY();
  side.half_u = 0.1;
  side.half_v = 0.05;
  return side;
}

TEST(NearestEdge, IsTheOneThatTheSilhouetteFaces) {
  EdgeLine line{};
  // In a corner, 1 cm from the edge +v and 2 cm from +u: the direction decides.
  const Eigen::Vector3d p(0.06, 0, 0.12);
  ASSERT_TRUE(NearestEdge(Table(), p, Eigen::Vector3d::UnitX(), 0.05, &line));
  EXPECT_EQ(line.edge, 2);
  EXPECT_NEAR(line.direction.dot(p) - line.offset, 0.01, 1e-12);
  ASSERT_TRUE(NearestEdge(Table(), p, Eigen::Vector3d::UnitZ(), 0.05, &line));
  EXPECT_EQ(line.edge, 0);
  EXPECT_NEAR(line.direction.dot(p) - line.offset, 0.02, 1e-12);
  // In between, the nearer one.
  ASSERT_TRUE(NearestEdge(Table(), p, Eigen::Vector3d(1, 0, 1).normalized(), 0.05, &line));
  EXPECT_EQ(line.edge, 2);
  EXPECT_FALSE(NearestEdge(Table(), p, Eigen::Vector3d::UnitX(), 0.009, &line)) << "the gate";
  EXPECT_FALSE(NearestEdge(Table(), p, Eigen::Vector3d::UnitY(), 0.05, &line)) << "no edge";
}

TEST(LiesOnItsSide, AsksForDistanceAndDirection) {
  const Structure structure = testing_infer::PaperStructure();
  const int label = testing_infer::LabelOf(structure, "top/front");
  const Side& side = structure.SideOfLabel(label);
  const FrameState sensor{testing_infer::RingPose(0), 0, 0};
  const Pose sensor_from_structure = sensor.structure_from_sensor.inverse();
  SidePoint point;
  point.label = label;
  point.p = sensor_from_structure * (side.centre + 0.03 * side.normal);
  point.normal.setZero();
  EXPECT_TRUE(LiesOnItsSide(structure, sensor, point, 0.04));
  EXPECT_FALSE(LiesOnItsSide(structure, sensor, point, 0.02));
  point.normal = sensor_from_structure.linear() * side.normal;
  EXPECT_TRUE(LiesOnItsSide(structure, sensor, point, 0.04));
  point.normal = sensor_from_structure.linear() * side.axis_u;
  EXPECT_FALSE(LiesOnItsSide(structure, sensor, point, 0.04)) << "a label that leaks round an edge";
  // A depth error that the sensor is known to have counts for nothing.
  point.normal.setZero();
  const double shift =
      0.03 / side.normal.dot(sensor.structure_from_sensor.linear() * point.p) * point.p.z();
  EXPECT_TRUE(LiesOnItsSide(structure, {sensor.structure_from_sensor, 0, -shift}, point, 0.001));
}

}  // namespace
}  // namespace volalign::refine_internal::association_test
