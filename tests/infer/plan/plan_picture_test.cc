#include "infer/plan/plan_picture.h"

#include <gtest/gtest.h>

#include "tests/infer/view/synthetic.h"

namespace volalign::plan_picture_test {
namespace {

TEST(PlanPicture, NamesAreText) {
  RigPlan plan;
  plan.structure =
      Structure::FromBoxes("stack", {Box::FromMinMax("a<b & c>d", Eigen::Vector3d(-0.25, 0, -0.2),
                                                     Eigen::Vector3d(0.25, 0.3, 0.2))});
  PlannedSensor sensor;
  sensor.name = "<S1>";
  sensor.intrinsics = testing_infer::Kinect();
  sensor.structure_from_sensor = testing_infer::RingPose(30);
  plan.sensors = {sensor};
  const std::string svg = PlanPicture(plan);
  EXPECT_NE(svg.find("<title>a&lt;b &amp; c&gt;d</title>"), std::string::npos) << svg;
  EXPECT_NE(svg.find(">&lt;S1&gt;</text>"), std::string::npos) << svg;
}

}  // namespace
}  // namespace volalign::plan_picture_test
