#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "core/geometry/lens.h"
#include "infer/formats/poses/codecs.h"
#include "tests/core/base/comma_locale.h"
#include "tests/core/base/expect_error.h"

namespace volalign::poses_internal {
namespace {

SensorPose Sensor() {
  SensorPose sensor;
  sensor.name = "S1";
  sensor.structure_from_sensor.translation() = Eigen::Vector3d(0.1, -0.2, -2.1);
  sensor.intrinsics = Intrinsics{30, 20, 25, 25, 14, 9, {0.1, -0.05, 1e-3, 2e-3}};
  sensor.depth_gain = 1.01;
  sensor.depth_offset_m = -0.008;
  return sensor;
}

// A pixel's four numbers make the point that the lens sees there, at the corrected depth.
TEST(DepthCorrection, MakesPointsOfPixels) {
  const SensorPose sensor = Sensor();
  const std::string bytes = WriteDepthCorrection({sensor}, {}).at("S1.npy");
  const std::size_t header = 10 + static_cast<unsigned char>(bytes[8]);
  EXPECT_EQ(header % 64, 0u);
  EXPECT_EQ(bytes[header - 1], '\n');
  EXPECT_EQ(bytes.substr(1, 5), "NUMPY");
  EXPECT_TRUE(Has(bytes, "'<f4'", "(20, 30, 4)"));
  std::vector<float> values(20 * 30 * 4);
  ASSERT_EQ(bytes.size(), header + values.size() * sizeof(float));
  std::memcpy(values.data(), bytes.data() + header, values.size() * sizeof(float));
  for (const auto& [u, v] : {std::pair(3, 5), std::pair(29, 19), std::pair(0, 0)}) {
    const float* pixel = values.data() + 4 * (v * 30 + u);
    const Eigen::Vector2d seen = ProjectRay(*sensor.intrinsics, {pixel[0], pixel[1]});
    EXPECT_LT((seen - Eigen::Vector2d(u, v)).norm(), 1e-3);
    EXPECT_FLOAT_EQ(pixel[2], 1.01F);
    EXPECT_FLOAT_EQ(pixel[3], -0.008F);
  }
}

TEST(DepthCorrection, ThePoseOfRawDepthsLeavesWhatTheGainDoesToSizes) {
  SensorPose sensor = Sensor();
  sensor.depth_gain = 1;
  ProcrustesResult raw = PoseForRawDepth(sensor);
  // A constant error moves points along their rays, which a shift nearly undoes.
  EXPECT_NEAR(raw.target_from_source.translation().z(), -2.108, 5e-4);
  EXPECT_LT(raw.rms, 0.0025);
  sensor.depth_gain = 1.02;
  sensor.depth_offset_m = 0;
  raw = PoseForRawDepth(sensor);
  // Seen in the middle at 2.1 m, the stack is 2 % nearer and smaller.
  EXPECT_NEAR(raw.target_from_source.translation().z(), -2.1 / 1.02, 1e-3);
  EXPECT_GT(raw.rms, 0.005);
  EXPECT_LT(raw.rms, 0.02);
  sensor.structure_from_sensor.linear() =
      Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitY()).toRotationMatrix();
  ExpectError<ConfigError>([&] { PoseForRawDepth(sensor); }, {"S1", "does not look at"});
}

TEST(DepthCorrection, ShiftOfALens) {
  SensorPose sensor = Sensor();
  EXPECT_EQ(LensShift(sensor), 0);
  sensor.intrinsics_given = sensor.intrinsics;
  EXPECT_EQ(LensShift(sensor), 0);
  sensor.intrinsics_given->cy += 0.5;
  EXPECT_NEAR(LensShift(sensor), 0.5 / 25 * 3.1, 1e-3);  // of the farthest point in the middle
}

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

TEST(YamlCodecs, ADecimalCommaOfTheLocaleChangesNothing) {
  const CommaLocale locale;
  const SensorPose sensor = Sensor();
  for (const SensorPose& read : {ReadOpencv(WriteOpencv({sensor}, {}), "poses.yaml").at(0),
                                 ReadRos(WriteRos({sensor}, {}), "poses.yaml").at(0)}) {
    EXPECT_TRUE(read.structure_from_sensor.isApprox(sensor.structure_from_sensor));
    EXPECT_EQ(read.depth_gain, sensor.depth_gain);
    EXPECT_EQ(read.depth_offset_m, sensor.depth_offset_m);
  }
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
