#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/geometry/lens.h"
#include "infer/formats/poses/codecs.h"
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
  const std::string bytes = WriteDepthCorrection({sensor}).at("S1.npy");
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

}  // namespace
}  // namespace volalign::poses_internal
