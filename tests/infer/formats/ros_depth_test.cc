#include "infer/formats/ros_depth.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "tests/core/base/expect_error.h"

namespace volalign::formats_internal::ros_depth_test {
namespace {

TEST(IsDepth, GoesByTheEncodingAndTheName) {
  EXPECT_TRUE(IsDepth("/a", "16UC1"));
  EXPECT_TRUE(IsDepth("/a", "32FC1"));
  EXPECT_TRUE(IsDepth("/camera/Depth/image", "mono16"));
  EXPECT_FALSE(IsDepth("/camera/infra1/image", "mono16"));
  EXPECT_FALSE(IsDepth("/camera/depth/image", "rgb8"));
  for (const char* other : {"/kinect2/sd/image_ir", "/camera/infra1/image_rect_raw",
                            "/depth_camera/ir/image_raw", "/camera/depth/confidence"})
    EXPECT_FALSE(IsDepth(other, "16UC1")) << other;
  for (const char* depth : {"/camera/aligned_depth_to_color/image_raw", "/depth_to_rgb/image_raw",
                            "/ir_camera/depth/image", "/camera/rgb/image_depth", "/firing/z"})
    EXPECT_TRUE(IsDepth(depth, "16UC1")) << depth;
}

TEST(DecodeImage, ReadsRowsOfAnyStepInEitherByteOrder) {
  RosImage image;
  image.width = 2;
  image.height = 2;
  image.step = 5;  // a byte that is not the picture's
  image.encoding = "16UC1";
  const std::string little("\x01\x02\x03\x00x\x00\x00\xff\x00x", 10);
  image.data = little;
  StoredDepth depth = DecodeImage(image, "file");
  EXPECT_TRUE(depth.whole_numbers);
  EXPECT_EQ(depth.values(0, 0), 0x201);
  EXPECT_EQ(depth.values(1, 0), 3);
  EXPECT_EQ(depth.values(0, 1), 0);
  EXPECT_EQ(depth.values(1, 1), 255);
  image.big_endian = true;
  depth = DecodeImage(image, "file");
  EXPECT_EQ(depth.values(0, 0), 0x102);
  EXPECT_EQ(depth.values(1, 1), 0xff00);
  image.height = 3;
  ExpectError<DataError>([&] { DecodeImage(image, "file"); }, {"file", "2x3"});
  image.height = 2;
  image.step = 3;
  ExpectError<DataError>([&] { DecodeImage(image, "file"); }, {"file", "2x2"});
}

TEST(DecodeImage, FloatsThatAreNoMeasurementAreZero) {
  const float values[] = {1.25F, std::nanf(""), std::numeric_limits<float>::infinity(), -1};
  std::string bytes(sizeof(values), '\0');
  std::memcpy(bytes.data(), values, sizeof(values));
  RosImage image;
  image.width = 4;
  image.height = 1;
  image.step = 16;
  image.encoding = "32FC1";
  image.data = bytes;
  const StoredDepth depth = DecodeImage(image, "file");
  EXPECT_FALSE(depth.whole_numbers);
  EXPECT_EQ(depth.values(0, 0), 1.25F);
  for (int u = 1; u < 4; ++u) EXPECT_EQ(depth.values(u, 0), 0) << u;
}

CameraInfo Info(double fx, const std::vector<double>& lens) {
  return {{640, 480, fx, fx + 1, 319, 239, lens},
          {640, 480, fx / 2, fx / 2 + 1, 318, 238, std::vector<double>(5, 0.0)},
          "plumb_bob",
          ""};
}

/// With a frame of the size that Info has.
void AddStream(const std::string& topic, const std::string& frame, RosContent* content) {
  RosStream& stream = content->streams[topic];
  stream.stream = topic;
  stream.frame = frame;
  stream.frames.push_back({Image<float>(640, 480), true});
}

TEST(DescribeStreams, TakesWhatSharesMostOfTheTopic) {
  RosContent content;
  AddStream("/device_0/sensor_0/Depth_0/image/data", "Depth", &content);
  AddStream("/other/depth", "", &content);
  content.infos["/device_0/sensor_0/Depth_0/info/camera_info"] = Info(500, {0, 0, 0, 0, 0});
  content.infos["/device_0/sensor_1/Color_0/info/camera_info"] = Info(900, {0, 0, 0, 0, 0});
  content.units["/device_0/sensor_0/option/Depth Units/value"] = 0.0010000000474974513;
  AddDevicePair("Name", "Intel RealSense D415", &content.devices["/device_0/info"]);
  AddDevicePair("Serial Number", "123", &content.devices["/device_0/info"]);
  const std::vector<RecordedDepth> streams = DescribeStreams(content, "file").streams;
  ASSERT_EQ(streams.size(), 2u);
  ASSERT_TRUE(streams[0].intrinsics);
  EXPECT_EQ(streams[0].intrinsics->fx, 500);
  EXPECT_EQ(streams[0].intrinsics->fy, 501);
  EXPECT_EQ(streams[0].intrinsics->cx, 319);
  EXPECT_EQ(streams[0].intrinsics->cy, 239);
  EXPECT_EQ(streams[0].depth_scale, 0.001);  // as it was written, not as a float has it
  EXPECT_EQ(streams[0].device, "Intel RealSense D415");
  EXPECT_EQ(streams[0].serial, "123");
  EXPECT_EQ(streams[0].kind, "realsense_d415");
  // Nothing is said of the other one: ROS's own unit.
  EXPECT_FALSE(streams[1].intrinsics);
  EXPECT_EQ(streams[1].depth_scale, 0.001);
  EXPECT_NE(streams[1].depth_scale_source, streams[0].depth_scale_source);
  EXPECT_EQ(streams[1].device, "");
}

// No unit of a recording: the capture has to state one.
TEST(DescribeStreams, AUnitThatIsNoneIsNotTaken) {
  for (const double unit : {0.0, -1.0, std::nan(""), HUGE_VAL, 1e-320}) {
    RosContent content;
    AddStream("/a/depth", "", &content);
    content.streams["/a/depth"].depth_scale = 1;
    content.units["/a/option/Depth Units/value"] = unit;
    const std::optional<double> scale = DescribeStreams(content, "file").streams[0].depth_scale;
    EXPECT_EQ(scale.has_value(), unit == 1e-320) << unit;
  }
}

TEST(DescribeStreams, ARectifiedImageHasTheCameraWithoutTheLens) {
  for (const char* name : {"image_rect", "image_raw"}) {
    RosContent content;
    const std::string topic = std::string("/camera/depth/") + name;
    AddStream(topic, "", &content);
    content.infos["/camera/depth/camera_info"] = Info(500, {0.1, 0, 0, 0, 0});
    const Intrinsics found = DescribeStreams(content, "file").streams[0].intrinsics.value();
    const bool rectified = std::string(name) == "image_rect";
    EXPECT_EQ(found.fx, rectified ? 250 : 500);
    EXPECT_EQ(found.fy, rectified ? 251 : 501);
    EXPECT_EQ(found.cx, rectified ? 318 : 319);
    EXPECT_EQ(found.cy, rectified ? 238 : 239);
    EXPECT_EQ(found.distortion[0], rectified ? 0 : 0.1);
  }
}

TEST(RealSenseTopics, AreKnownByTheirNames) {
  EXPECT_TRUE(IsDeviceInfo("/device_0/info"));
  EXPECT_FALSE(IsDeviceInfo("/device_0/sensor_0/info"));
  EXPECT_FALSE(IsDeviceInfo("/camera/info"));
  EXPECT_TRUE(IsDepthUnits("/device_0/sensor_0/option/Depth Units/value"));
  EXPECT_TRUE(IsDepthUnits("/device_0/sensor_0/option/Depth_Units/value"));
  EXPECT_FALSE(IsDepthUnits("/device_0/sensor_0/option/Depth Units/description"));
}

}  // namespace
}  // namespace volalign::formats_internal::ros_depth_test
