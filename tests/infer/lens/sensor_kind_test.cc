#include "infer/lens/sensor_kind.h"

#include <gtest/gtest.h>

namespace volalign::sensor_kind_test {
namespace {

TEST(FindSensorKind, IsTheOneWhoseNamesBeginSo) {
  const SensorKind* azure = FindSensorKind("azure_kinect_nfov_binned");
  ASSERT_NE(azure, nullptr);
  EXPECT_EQ(azure->principle, DepthPrinciple::kTimeOfFlight);
  ASSERT_TRUE(azure->lens.has_value());
  EXPECT_FALSE(azure->lens->rectified());
  ASSERT_NE(FindSensorKind("realsense_d415"), nullptr);
  EXPECT_TRUE(FindSensorKind("realsense_d415")->lens->rectified());
  ASSERT_NE(FindSensorKind("kinect_v1"), nullptr);
  EXPECT_FALSE(FindSensorKind("kinect_v1")->lens.has_value());
  EXPECT_EQ(FindSensorKind("my_azure_kinect"), nullptr);
  EXPECT_EQ(FindSensorKind(""), nullptr);
}

TEST(MeasuresBy, IsOfKnownKindsOnly) {
  EXPECT_TRUE(MeasuresBy(DepthPrinciple::kStereo, "realsense_d455"));
  EXPECT_TRUE(MeasuresBy(DepthPrinciple::kStereo, "kinect_v1"));
  EXPECT_TRUE(MeasuresBy(DepthPrinciple::kTimeOfFlight, "kinect_v2"));
  EXPECT_FALSE(MeasuresBy(DepthPrinciple::kTimeOfFlight, "kinect_v1"));
  for (const DepthPrinciple principle : {DepthPrinciple::kStereo, DepthPrinciple::kTimeOfFlight})
    EXPECT_FALSE(MeasuresBy(principle, "lidar"));
}

}  // namespace
}  // namespace volalign::sensor_kind_test
