#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cstdio>
#include <string>
#include <vector>

#include "infer/formats/poses/codecs.h"

#include "tests/core/base/expect_error.h"

namespace volalign::poses_internal {
namespace {

Poses TwoSensors() {
  Poses poses(2);
  poses[0].name = "S1";
  poses[0].structure_from_sensor = Eigen::Translation3d(0.1, -0.2, -2.1) *
                                   Eigen::AngleAxisd(2.5, Eigen::Vector3d(1, -2, 0.5).normalized());
  poses[1].name = "S & \"2\"";
  poses[1].structure_from_sensor =  // the nose up: roll and yaw turn about one axis
      Eigen::Translation3d(3, 0, 1) * Eigen::AngleAxisd(-M_PI / 2, Eigen::Vector3d::UnitY()) *
      Eigen::AngleAxisd(0.4, Eigen::Vector3d::UnitX());
  return poses;
}

/// The numbers between `from` and the next `until` after position `at`, which moves behind them.
std::vector<double> NumbersAt(const std::string& text, const std::string& from, char until,
                              std::size_t* at) {
  *at = text.find(from, *at);
  EXPECT_NE(*at, std::string::npos);
  *at += from.size();
  const std::size_t end = text.find(until, *at);
  std::vector<double> numbers;
  const char* c = text.c_str() + *at;
  int used = 0;
  for (double x = 0; c < text.c_str() + end && std::sscanf(c, "%lf%n", &x, &used) == 1; c += used)
    numbers.push_back(x);
  *at = end;
  return numbers;
}

TEST(YamlCodecs, ALaunchFilePublishesEachTransform) {
  const Poses poses = TwoSensors();
  const std::string text = WriteRosLaunch(poses, {"z up", "base", false});
  std::size_t at = 0;
  for (const SensorPose& sensor : poses) {
    const auto number = [&](const char* key) {
      return NumbersAt(text, std::string("\"--") + key + "\", \"", '"', &at).at(0);
    };
    Eigen::Vector3d t;
    for (int i = 0; i < 3; ++i) t[i] = number(i == 0 ? "x" : i == 1 ? "y" : "z");
    const double x = number("qx"), y = number("qy"), z = number("qz"), w = number("qw");
    EXPECT_LT((t - sensor.structure_from_sensor.translation()).norm(), 1e-12);
    EXPECT_LT(
        (Eigen::Quaterniond(w, x, y, z).toRotationMatrix() - sensor.structure_from_sensor.linear())
            .norm(),
        1e-9);
  }
  EXPECT_NE(text.find("\"--frame-id\", \"base\", \"--child-frame-id\", "
                      "\"S & \\\"2\\\"_depth_optical_frame\""),
            std::string::npos);
}

TEST(YamlCodecs, UrdfHasAJointForEachSensor) {
  const Poses poses = TwoSensors();
  const std::string text = WriteUrdf(poses, {"z up", "base", true});
  std::size_t at = 0;
  for (const SensorPose& sensor : poses) {
    const std::vector<double> t = NumbersAt(text, "xyz=\"", '"', &at);
    const std::vector<double> rpy = NumbersAt(text, "rpy=\"", '"', &at);
    ASSERT_EQ(t.size() + rpy.size(), 6u);
    const Eigen::Matrix3d rotation = (Eigen::AngleAxisd(rpy[2], Eigen::Vector3d::UnitZ()) *
                                      Eigen::AngleAxisd(rpy[1], Eigen::Vector3d::UnitY()) *
                                      Eigen::AngleAxisd(rpy[0], Eigen::Vector3d::UnitX()))
                                         .toRotationMatrix();
    EXPECT_LT((rotation - sensor.structure_from_sensor.linear()).norm(), 1e-9);
    EXPECT_EQ(Eigen::Vector3d(t[0], t[1], t[2]), sensor.structure_from_sensor.translation());
  }
  EXPECT_TRUE(Has(text, "<child link=\"S1_color_optical_frame\"/>"));
  EXPECT_TRUE(Has(text, "S &#38; &#34;2&#34;_joint"));
}

}  // namespace
}  // namespace volalign::poses_internal
