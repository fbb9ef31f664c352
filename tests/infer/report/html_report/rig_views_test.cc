#include "infer/report/html_report/rig_views.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

#include "tests/infer/view/synthetic.h"

namespace volalign::rig_views_test {
namespace {

using testing_infer::Kinect;
using testing_infer::PaperStructure;
using testing_infer::RingPose;

FrameResult Seen(const std::string& name, const Structure& structure, const Pose& pose) {
  FrameResult sensor;
  sensor.name = name;
  sensor.status = SensorStatus::kOk;
  sensor.intrinsics = Kinect();
  sensor.structure_from_sensor = pose;
  sensor.covariance = 1e-5 * Matrix6d::Identity();
  const testing_infer::SyntheticView frame =
      testing_infer::Render(structure, Kinect(), pose, {false, 0});
  sensor.view = MakeSensorView(frame.depth, Kinect());
  return sensor;
}

bool Has(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

TEST(PlacedFromAbove, SaysDistanceAndHeightOfEachPlacedSensor) {
  const Structure structure = PaperStructure();
  Pose pose = RingPose(90);
  pose.translation() = Eigen::Vector3d(0, structure.FloorHeight() + 1.25, 2.5);
  FrameResult failed;
  failed.name = "S2";
  const std::string svg = PlacedFromAbove({Seen("S1", structure, pose), failed}, structure);
  EXPECT_TRUE(Has(svg, "2.50 m, 1.25 m high")) << svg;
  EXPECT_TRUE(Has(svg, "at 90° from x towards z")) << svg;
  EXPECT_TRUE(Has(svg, "known to")) << svg;
  EXPECT_TRUE(Has(svg, "ellipses: 2 standard deviations")) << svg;
  EXPECT_FALSE(Has(svg, "S2")) << "it has no pose";
}

TEST(TwinJson, ShowsTheSensorsThatStandElsewhere) {
  const Structure structure = PaperStructure();
  const Pose at = RingPose(40), other = RingPose(130);
  const std::vector<FrameResult> sensors = {Seen("S1", structure, at),
                                            Seen("S2", structure, RingPose(200))};
  RigTwin twin;
  twin.sensors = {{"S1", 2, other}};
  const nlohmann::ordered_json json = TwinJson(twin, sensors, sensors, structure, Pose::Identity());
  ASSERT_EQ(json["frames"].size(), 1u);
  EXPECT_EQ(json["frames"][0]["sensor"], "S1");
  EXPECT_GT(json["frames"][0]["outlines_differ"], 0.01);
  EXPECT_LT(json["frames"][0]["outlines_differ"], 1);
  EXPECT_NE(json["from_above"], PlacedFromAbove(sensors, structure));
  EXPECT_TRUE(Has(json["from_above"], "elsewhere"));
  EXPECT_FALSE(Has(json["from_above"], "ellipses")) << "the other poses have no covariance";
  twin.sensors = {{"S1", 2, at}};
  EXPECT_EQ(
      TwinJson(twin, sensors, sensors, structure, Pose::Identity())["frames"][0]["outlines_differ"],
      0);
  // In another still's structure the pose is another one.
  Pose moved = Pose::Identity();
  moved.translation().x() = 1;
  twin.sensors = {{"S1", 2, moved * at}};
  EXPECT_NEAR(TwinJson(twin, sensors, sensors, structure, moved)["frames"][0]["outlines_differ"], 0,
              1e-3);
}

}  // namespace
}  // namespace volalign::rig_views_test
