// Forms of recordings that no file in this folder has, each written here from its format's
// description.

#include <bzlib.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <lz4frame.h>
#include <sqlite3.h>
#include <zstd.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <iterator>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "infer/capture/capture.h"
#include "infer/formats/recording.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/read_file.h"
#include "tests/core/base/temp_folder.h"
#include "tests/infer/formats/bag_writer.h"

namespace volalign::described_recordings_test {
namespace {

using namespace bag_writer;

constexpr int kWidth = 3, kHeight = 2;
/// Both bytes of each value differ, so that a byte order is told from the other one.
constexpr std::uint16_t kDepth[kWidth * kHeight] = {0, 1001, 1258, 4660, 2, 65279};

std::string Samples(bool big_endian) {
  std::string bytes;
  for (const std::uint16_t value : kDepth) {
    const char low = static_cast<char>(value & 0xff), high = static_cast<char>(value >> 8);
    bytes += big_endian ? high : low;
    bytes += big_endian ? low : high;
  }
  return bytes;
}

/// The same in metres, with a NaN for what is no measurement.
std::string Metres() {
  std::string bytes;
  for (const std::uint16_t value : kDepth) {
    const float metres = value == 0 ? std::nanf("") : 0.001F * value;
    bytes.append(reinterpret_cast<const char*>(&metres), sizeof(metres));
  }
  return bytes;
}

struct Picture {
  std::string encoding;
  bool big_endian = false;
  std::string data;
};

Picture Plain() { return {"16UC1", false, Samples(false)}; }

std::uint32_t Step(const Picture& picture) {
  return static_cast<std::uint32_t>(picture.data.size() / kHeight);
}

void ExpectDepth(const std::vector<RecordedDepth>& streams, const std::string& stream,
                 double depth_scale, double file_unit) {
  ASSERT_EQ(streams.size(), 1u);
  EXPECT_EQ(streams[0].stream, stream);
  ASSERT_TRUE(streams[0].depth_scale.has_value());
  EXPECT_EQ(*streams[0].depth_scale, depth_scale);
  ASSERT_EQ(streams[0].frames.size(), 1u);
  const StoredDepth& frame = streams[0].frames[0];
  EXPECT_EQ(frame.whole_numbers, file_unit == 1);
  ASSERT_EQ(frame.values.width(), kWidth);
  ASSERT_EQ(frame.values.height(), kHeight);
  for (std::size_t i = 0; i < frame.values.size(); ++i)
    EXPECT_FLOAT_EQ(frame.values[i], static_cast<float>(file_unit * kDepth[i])) << i;
}

/// Where the colour camera has (1, 2, 3) of the depth camera.
void ExpectSeenByColour(const std::vector<RecordedDepth>& streams, const Eigen::Vector3d& at,
                        double tolerance = 1e-9) {
  ASSERT_EQ(streams.size(), 1u);
  ASSERT_TRUE(streams[0].colour);
  const Eigen::Vector3d p = streams[0].colour->colour_from_depth * Eigen::Vector3d(1, 2, 3);
  EXPECT_LT((p - at).norm(), tolerance);
}

// Bags of ROS 1.

template <class T>
std::string Many(const std::vector<T>& values) {
  std::string bytes;
  for (const T value : values) bytes += Bytes(value);
  return bytes;
}

/// sensor_msgs/Image, serialised (wiki.ros.org/msg): little-endian, without padding.
std::string RosMessage(const Picture& picture = Plain(), const std::string& frame = "camera") {
  return MessageHeader(frame) + Many<std::uint32_t>({kHeight, kWidth}) + Block(picture.encoding) +
         static_cast<char>(picture.big_endian) + Bytes(Step(picture)) + Block(picture.data);
}

/// Each on a connection of its own.
std::string RosImage(std::uint32_t number, const std::string& topic, const std::string& message) {
  return Topic(number, topic, "sensor_msgs/Image", message);
}
std::string RosCameraInfo(std::uint32_t number, const std::string& topic,
                          const std::string& message) {
  return Topic(number, topic, "sensor_msgs/CameraInfo", message);
}

/// What is read of a bag of these records.
std::vector<RecordedDepth> ReadRecords(const std::string& records,
                                       ReadBudget budget = ReadBudget()) {
  const TempFolder folder;
  return ReadRecording(folder.Write("a.bag", Bag(records)), 2, &budget);
}

std::string PackBz2(const std::string& content) {
  std::string packed(content.size() + 1000, '\0');
  auto size = static_cast<unsigned int>(packed.size());
  EXPECT_EQ(BZ2_bzBuffToBuffCompress(packed.data(), &size, const_cast<char*>(content.data()),
                                     static_cast<unsigned int>(content.size()), 9, 0, 0),
            BZ_OK);
  packed.resize(size);
  return packed;
}

std::string PackLz4(const std::string& content) {
  std::string packed(LZ4F_compressFrameBound(content.size(), nullptr), '\0');
  packed.resize(
      LZ4F_compressFrame(packed.data(), packed.size(), content.data(), content.size(), nullptr));
  return packed;
}

std::vector<RecordedDepth> ReadBag(const Picture& picture, const std::string& compression,
                                   const std::string& topic = "/camera/depth") {
  const std::string content = RosImage(0, topic, RosMessage(picture));
  const std::string packed = compression == "bz2"   ? PackBz2(content)
                             : compression == "lz4" ? PackLz4(content)
                                                    : content;
  return ReadRecords(PackedChunk(content, compression, packed));
}

TEST(DescribedBag, ChunksOfAllKinds) {
  for (const char* compression : {"none", "bz2", "lz4"}) {
    SCOPED_TRACE(compression);
    ExpectDepth(ReadBag(Plain(), compression), "/camera/depth", 0.001, 1);
  }
}

TEST(DescribedBag, EncodingsAndByteOrders) {
  ExpectDepth(ReadBag({"16UC1", true, Samples(true)}, "none"), "/camera/depth", 0.001, 1);
  ExpectDepth(ReadBag({"mono16", false, Samples(false)}, "none"), "/camera/depth", 0.001, 1);
  ExpectDepth(ReadBag({"mono16", true, Samples(true)}, "none"), "/camera/depth", 0.001, 1);
  ExpectDepth(ReadBag({"32FC1", false, Metres()}, "none"), "/camera/depth", 1, 0.001);
}

// What Orbbec's recorder writes (OrbbecSDK v2, src/media/ros): images with further fields behind
// the standard ones, and stream profiles of fixed arrays.

struct OrbbecProfileFields {
  std::uint8_t type = 3, model = 4;
  std::vector<float> rotation = {0, -1, 0, 1, 0, 0, 0, 0, 1}, translation = {-32, 2, 4};
  std::vector<float> lens = {16.17F, 8.45F, 0.324F, 16.48F, 13.94F, 1.996F, 6e-5F, -1.5e-5F};
};

std::string OrbbecProfile(const OrbbecProfileFields& fields) {
  return MessageHeader() + static_cast<char>(fields.type) + '\x01' + Many(fields.rotation) +
         Many(fields.translation) + Many<std::uint16_t>({kWidth, kHeight, 30}) +
         Many<float>({2.5F, 2.25F, 1.5F, 0.5F}) + Many(fields.lens) +
         static_cast<char>(fields.model);
}

/// SDKs before pixel_bit_size end with the size of the metadata.
std::string OrbbecImage(const std::string& encoding, bool older_sdk = false) {
  return RosMessage({encoding, false, Samples(false)}) + Many<float>({0}) +
         Many<std::uint64_t>({7, 1, 2, 3}) + Block("meta") + Many<std::uint32_t>({4}) +
         (older_sdk ? "" : "\x10");
}

/// custom_msg/property.
template <class T>
std::string OrbbecProperty(std::uint32_t number, T value) {
  return MessageHeader() + Bytes(number) + Block(Bytes(value)) + Bytes(std::uint32_t{sizeof(T)});
}

std::string OrbbecDevice(const std::string& device) {
  return MessageHeader() + Block(device) + Block("more");
}

constexpr char kOrbbecDepth[] = "/cam/sensor_3/frameType_3";

std::string OrbbecRecords(const std::string& encoding, const OrbbecProfileFields& profile,
                          const std::string& device = "Orbbec Femto Bolt",
                          const std::vector<std::string>& properties = {}) {
  OrbbecProfileFields colour;
  colour.type = 2;
  colour.model = 3;
  std::string records = Connection(5, "/cam/property", "custom_msg/property");
  for (const std::string& property : properties) records += Message(5, property);
  const std::string kind = "custom_msg/StreamProfileInfo";
  return Chunk(records + RosImage(0, "/cam/sensor_1/frameType_1", OrbbecImage("mono16")) +
               RosImage(1, kOrbbecDepth, OrbbecImage(encoding)) +
               Topic(2, "/cam/deviceInfo", "custom_msg/DeviceInfo", OrbbecDevice(device)) +
               Topic(3, "/cam/streamProfileType_3", kind, OrbbecProfile(profile)) +
               Topic(4, "/cam/streamProfileType_2", kind, OrbbecProfile(colour)));
}

TEST(OrbbecBag, DepthWithItsLensAndColourCamera) {
  for (const char* encoding : {"mono16", "z16"}) {
    const auto streams = ReadRecords(OrbbecRecords(encoding, {}));  // infrared is none
    ExpectDepth(streams, kOrbbecDepth, 0.001, 1);
    EXPECT_EQ(streams[0].device, "Orbbec Femto Bolt");
    EXPECT_EQ(streams[0].kind, "orbbec_femto_bolt");
    ASSERT_TRUE(streams[0].intrinsics);
    const Intrinsics& k = *streams[0].intrinsics;
    EXPECT_EQ(k.width, kWidth);
    EXPECT_EQ(k.fy, 2.25);
    // OpenCV's order: k1 k2 p1 p2 k3 k4 k5 k6.
    ASSERT_EQ(k.distortion.size(), 8u);
    EXPECT_FLOAT_EQ(static_cast<float>(k.distortion[1]), 8.45F);
    EXPECT_FLOAT_EQ(static_cast<float>(k.distortion[2]), 6e-5F);
    EXPECT_FLOAT_EQ(static_cast<float>(k.distortion[4]), 0.324F);
    EXPECT_FLOAT_EQ(static_cast<float>(k.distortion[7]), 1.996F);
    ExpectSeenByColour(streams, {-2 - 0.032, 1 + 0.002, 3.004}, 1e-6);
    ASSERT_TRUE(streams[0].colour->intrinsics);
    EXPECT_EQ(streams[0].colour->intrinsics->fx, 2.5);
  }
}

TEST(OrbbecBag, WhatItDoesNotKnowItNames) {
  ExpectError<DataError>([] { ReadRecords(OrbbecRecords("RVL", {})); },
                         {"a.bag", "RVL", "frameType_3"});
  OrbbecProfileFields fisheye;
  fisheye.model = 5;
  const auto other_lens = ReadRecords(OrbbecRecords("z16", fisheye));
  EXPECT_FALSE(other_lens[0].intrinsics);
  EXPECT_TRUE(Has(other_lens[0].intrinsics_problem, "lens model 5"));
  OrbbecProfileFields rectified;
  rectified.lens.assign(8, 0);
  rectified.model = 1;
  rectified.rotation.assign(9, 0);
  const auto plain = ReadRecords(OrbbecRecords("z16", rectified, "Orbbec Gemini 2"));
  EXPECT_EQ(plain[0].intrinsics->distortion, std::vector<double>(5, 0.0));
  EXPECT_FALSE(plain[0].colour);
  EXPECT_FALSE(plain[0].depth_scale) << "no property states the unit of this Gemini";
}

// Numbers of properties and levels: include/libobsensor/h/Property.h and ObTypes.h of OrbbecSDK v2;
// src/media/record/RecordDevice.cpp records them before the first frame.
TEST(OrbbecBag, UnitAmongTheProperties) {
  const auto read = [](const std::string& device, const std::vector<std::string>& properties) {
    return ReadRecords(OrbbecRecords("mono16", {}, "Orbbec " + device, properties));
  };
  const std::string other = OrbbecProperty<std::int32_t>(14, 6);  // not the unit
  ExpectDepth(read("Gemini 335", {other, OrbbecProperty(176, 0.25F)}), kOrbbecDepth, 0.00025, 1);
  const double levels[] = {0.001, 0.0008, 0.0004, 0.0001, 0.0002, 0.0005, 0.00005};
  for (std::int32_t level = 0; level < 7; ++level)
    ExpectDepth(read("Gemini 2", {OrbbecProperty(75, level), other}), kOrbbecDepth, levels[level],
                1);
  EXPECT_FALSE(read("Gemini 2", {OrbbecProperty<std::int32_t>(75, 7)})[0].depth_scale)
      << "a level that no SDK has named";
  EXPECT_FALSE(read("Gemini 335", {OrbbecProperty(176, 0.0F)})[0].depth_scale);
  ExpectDepth(read("Femto Mega", {OrbbecProperty<std::int32_t>(75, 3)}), kOrbbecDepth, 0.001, 1);
  // The device makes depth of its disparities, or leaves it to the SDK on playback.
  ExpectDepth(read("Gemini 335", {OrbbecProperty(85, '\1'), OrbbecProperty(176, 1.0F)}),
              kOrbbecDepth, 0.001, 1);
  ExpectError<DataError>([&] { read("Gemini 335", {OrbbecProperty(85, '\0')}); },
                         {"a.bag", "frameType_3", "disparities"});
}

TEST(OrbbecBag, OlderLayouts) {
  // OrbbecViewer 1 has the second topic (OrbbecSDK issue 195 shows its /cam0/color_raw).
  for (const char* topic : {kOrbbecDepth, "/cam0/depth_raw"})
    ExpectDepth(ReadRecords(Chunk(RosImage(0, topic, OrbbecImage("mono16", /*older_sdk=*/true)) +
                                  Topic(1, "/cam/deviceInfo", "custom_msg/DeviceInfo",
                                        MessageHeader() + Block("Orbbec Femto Bolt")))),
                topic, 0.001, 1);
}

TEST(DescribedBag, WithoutDepthSaysWhatIsInIt) {
  const Picture colour = {"rgb8", false, std::string(std::size_t{3} * kWidth * kHeight, 'x')};
  ExpectError<DataError>([&] { ReadBag(colour, "none", "/camera/color"); },
                         {"no depth stream", "/camera/color (sensor_msgs/Image)"});
}

/// sensor_msgs/CameraInfo of ROS 1, of that frame.
std::string RosCamera(const std::string& frame, double fx,
                      const std::vector<double>& lens = std::vector<double>(5, 0.0)) {
  return MessageHeader(frame) + Many<std::uint32_t>({kHeight, kWidth}) + Block("plumb_bob") +
         Bytes(static_cast<std::uint32_t>(lens.size())) + Many(lens) +
         Many<double>({fx, 0, 1, 0, fx, 0.5, 0, 0, 1}) + Many<double>({1, 0, 0, 0, 1, 0, 0, 0, 1}) +
         Many<double>({fx, 0, 1, 0, 0, fx, 0.5, 0, 0, 0, 1, 0});
}

/// What is read of a bag of images of depth, of `frame`, and a camera of (2, 3) on another topic.
RecordedDepth ReadWithCamera(const std::string& topic, const std::string& frame,
                             const std::string& camera_topic, const std::string& camera) {
  return ReadRecords(Chunk(RosImage(0, topic, RosMessage(Plain(), frame)) +
                           RosCameraInfo(1, camera_topic, camera)))
      .at(0);
}

// Depth and colour of one device share the front of their topics, and often the size.
TEST(DescribedBag, ACameraOfAnotherFrameIsNotTaken) {
  const std::string image = "/camera/depth/image_rect_raw", colour = "/camera/color/camera_info";
  for (const auto& [frame, other] :
       {std::pair("depth_optical_frame", "color_optical_frame"), std::pair("", ""),
        std::pair("camera_link", "camera_link")}) {  // as drivers that know one frame
    const RecordedDepth depth = ReadWithCamera(image, frame, colour, RosCamera(other, 2));
    EXPECT_FALSE(depth.intrinsics) << frame;
    EXPECT_TRUE(Has(depth.intrinsics_problem, colour));
  }
  EXPECT_FALSE(ReadWithCamera(image, "depth", "/camera/infra1/camera_info", RosCamera("infra1", 2))
                   .intrinsics);
  // Depth that is registered to the colour camera has its lens.
  for (const auto& [topic, frame] :
       {std::pair("/camera/aligned_depth_to_color/image_raw", "color_optical_frame"),
        std::pair("/camera/depth_registered/image_raw", "camera_link")}) {
    const RecordedDepth depth = ReadWithCamera(topic, frame, colour, RosCamera(frame, 2));
    ASSERT_TRUE(depth.intrinsics) << topic;
    EXPECT_EQ(depth.intrinsics_source, colour);
  }
  const RecordedDepth own =
      ReadWithCamera("/kinect2/sd/image_depth", "ir_optical_frame", "/kinect2/sd/camera_info",
                     RosCamera("ir_optical_frame", 2));
  EXPECT_EQ(own.intrinsics->fx, 2);
  EXPECT_EQ(own.intrinsics_source, "/kinect2/sd/camera_info");
}

// K[0] = 0 says that the camera is not calibrated (sensor_msgs/CameraInfo); P may say it all.
TEST(DescribedBag, ALensThatCannotBeUsedIsNoError) {
  const auto read = [](std::string camera, std::size_t zeros_at, std::size_t zeros) {
    camera.replace(camera.size() - zeros_at, zeros, zeros, '\0');
    return ReadWithCamera("/camera/depth/image_raw", "d", "/camera/depth/camera_info", camera);
  };
  constexpr std::size_t kP = 12 * 8, kAll = kP + 2 * 9 * 8;
  const std::string camera = RosCamera("d", 2, {0.1, 0, 0, 0, 0});
  EXPECT_TRUE(read(camera, 0, 0).intrinsics_stated);
  const RecordedDepth of_p = read(camera, kAll, 9 * 8);
  ASSERT_TRUE(of_p.intrinsics);
  EXPECT_EQ(of_p.intrinsics->fx, 2);
  EXPECT_EQ(of_p.intrinsics->distortion, std::vector<double>(5, 0.0));
  EXPECT_FALSE(of_p.intrinsics_stated);
  const RecordedDepth none = read(camera, kAll, kAll);
  EXPECT_FALSE(none.intrinsics);
  EXPECT_TRUE(Has(none.intrinsics_problem, "not calibrated"));
  EXPECT_EQ(none.frames.size(), 1u);
}

// Kinect v2's bridge has infrared in the same encoding as depth.
TEST(DescribedBag, InfraredIsNoDepth) {
  ExpectDepth(ReadRecords(Chunk(RosImage(0, "/kinect2/sd/image_ir", RosMessage()) +
                                RosImage(1, "/kinect2/sd/image_depth", RosMessage()))),
              "/kinect2/sd/image_depth", 0.001, 1);
  ExpectError<DataError>([&] { ReadBag(Plain(), "none", "/sd/image_ir_rect"); },
                         {"no depth stream", "image_ir_rect"});
}

// Each chunk is within its limit; their number is not.
TEST(DescribedBag, ManyChunksOfZeros) {
  const std::string zeros =
      Topic(0, "/x", "std_msgs/String", std::string(std::size_t{1} << 20, '\0'));
  const std::string packed = PackBz2(zeros);
  std::string chunks;
  for (int i = 0; i < 60; ++i) chunks += PackedChunk(zeros, "bz2", packed);
  ExpectError<DataError>([&] { ReadRecords(chunks, ReadBudget(std::uint64_t{1} << 24)); },
                         {"a.bag", "unpacked"});
}

// And so is each message.
TEST(DescribedBag, ManyMessagesOfNothing) {
  std::string messages =
      Connection(0, "/device_0/sensor_0/Depth_0/tf/0", "geometry_msgs/Transform");
  const std::string transform = Message(0, Many<double>({0, 0, 0, 0, 0, 0, 1}));
  for (int i = 0; i < 20000; ++i) messages += transform;
  const std::string packed = PackedChunk(messages, "bz2", PackBz2(messages));
  ExpectError<DataError>([&] { ReadRecords(packed, ReadBudget(std::uint64_t{1} << 22)); },
                         {"a.bag", "unpacked"});
}

/// geometry_msgs/TransformStamped.
std::string RosLink(const std::string& parent, const std::string& child,
                    const std::vector<double>& translation_and_quaternion) {
  return MessageHeader(parent) + Block(child) + Many(translation_and_quaternion);
}

// camera_link carries both cameras: the colour one 10 cm along its x and turned by a quarter about
// its z.
TEST(DescribedBag, ColourCameraByStaticTransforms) {
  const double half = std::sqrt(0.5);
  const std::string links = Bytes<std::uint32_t>(2) +
                            RosLink("camera_link", "depth_frame", {0, 0, 0.5, 0, 0, 0, 1}) +
                            RosLink("camera_link", "color_frame", {0.1, 0, 0, 0, 0, half, half});
  const auto streams =
      ReadRecords(Chunk(RosImage(0, "/camera/depth/image_raw", RosMessage()) +
                        RosCameraInfo(1, "/camera/depth/camera_info", RosCamera("depth_frame", 2)) +
                        RosCameraInfo(2, "/camera/color/camera_info", RosCamera("color_frame", 3)) +
                        Topic(3, "/tf_static", "tf2_msgs/TFMessage", links)));
  // (1, 2, 3) of the depth frame is (1, 2, 3.5) of the link; less 0.1 along x, turned back.
  ExpectSeenByColour(streams, {2, -0.9, 3.5});
  EXPECT_EQ(streams[0].intrinsics->fx, 2);
  EXPECT_EQ(streams[0].colour->intrinsics->fx, 3);
}

// Orbbec's ROS wrapper calls its rational lens plumb_bob: with eight coefficients it is OpenCV's.
TEST(DescribedBag, PlumbBobOfEightCoefficientsIsRational) {
  const std::vector<double> lens = {16.17, 8.45, 6e-5, -1.5e-5, 0.324, 16.48, 13.94, 1.996};
  const RecordedDepth depth =
      ReadWithCamera("/camera/depth/image_raw", "depth_frame", "/camera/depth/camera_info",
                     RosCamera("depth_frame", 2, lens));
  ASSERT_TRUE(depth.intrinsics);
  EXPECT_EQ(depth.intrinsics->distortion, lens);
}

// librealsense's recorder says where the reference stream is in each stream's frame.
TEST(DescribedBag, ColourCameraOfRealSense) {
  const double half = std::sqrt(0.5);
  const std::string depth = "/device_0/sensor_0/Depth_0", colour = "/device_0/sensor_1/Color_0";
  const std::string transform = "geometry_msgs/Transform";
  ExpectSeenByColour(
      ReadRecords(Chunk(
          RosImage(0, depth + "/image/data", RosMessage({"mono16", false, Samples(false)})) +
          RosCameraInfo(1, depth + "/info/camera_info", RosCamera("", 2)) +
          RosCameraInfo(2, colour + "/info/camera_info", RosCamera("", 3)) +
          Topic(3, depth + "/tf/0", transform, Many<double>({0, 0, 0, 0, 0, 0, 1})) +
          Topic(4, colour + "/tf/0", transform, Many<double>({0.015, 0, 0, half, 0, 0, half})))),
      {1.015, -3, 2});
}

// Bags of ROS 2.

/// CDR (OMG's DDSI-RTPS 2.5, section 10): little-endian, each number aligned to its size, counted
/// behind the header of four bytes.
class CdrWriter {
 public:
  template <class T>
  void Add(T value) {
    while ((bytes_.size() - 4) % sizeof(T) != 0) bytes_ += '\0';
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof(T));
  }
  void AddText(const std::string& text) { AddBytes(text + '\0'); }
  void AddBytes(const std::string& bytes) {
    Add(static_cast<std::uint32_t>(bytes.size()));
    bytes_ += bytes;
  }
  const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_ = std::string("\x00\x01\x00\x00", 4);
};

void AddCdrHeader(const std::string& frame, CdrWriter* writer) {
  writer->Add<std::int32_t>(1700000000);
  writer->Add<std::uint32_t>(0);
  writer->AddText(frame);
}

/// A message of sensor_msgs/msg/Image.
std::string CdrMessage(const Picture& picture = Plain()) {
  CdrWriter image;
  AddCdrHeader("camera", &image);
  image.Add<std::uint32_t>(kHeight);
  image.Add<std::uint32_t>(kWidth);
  image.AddText(picture.encoding);
  image.Add(static_cast<std::uint8_t>(picture.big_endian));
  image.Add(Step(picture));
  image.AddBytes(picture.data);
  return image.bytes();
}

/// sensor_msgs/msg/CameraInfo.
std::string CdrCamera(const std::string& frame, double fx) {
  CdrWriter info;
  AddCdrHeader(frame, &info);
  info.Add<std::uint32_t>(kHeight);
  info.Add<std::uint32_t>(kWidth);
  info.AddText("plumb_bob");
  const std::vector<double> d = {0.1, 0.2, 0.01, 0.02, 0.3};
  info.Add(static_cast<std::uint32_t>(d.size()));
  for (const auto& numbers : {d,
                              {fx, 0, 1, 0, fx, 0.5, 0, 0, 1},
                              {1, 0, 0, 0, 1, 0, 0, 0, 1},
                              {fx, 0, 1, 0, 0, fx, 0.5, 0, 0, 0, 1, 0}}) {
    for (const double x : numbers) info.Add(x);
  }
  return info.bytes();
}

/// tf2_msgs/msg/TFMessage of one transform: translation, quaternion x y z w.
std::string CdrLink(const std::string& parent, const std::string& child,
                    const std::vector<double>& pose) {
  CdrWriter links;
  links.Add<std::uint32_t>(1);
  AddCdrHeader(parent, &links);
  links.AddText(child);
  for (const double x : pose) links.Add(x);
  return links.bytes();
}

struct Db3Message {
  std::string topic, type, data;
};

/// A bag of messages, each on a topic of its own.
std::string WriteDb3(const TempFolder& folder, const std::vector<Db3Message>& messages,
                     const std::string& before = "") {
  std::string path = (folder / "a.db3").string();
  std::filesystem::remove(path);
  sqlite3* database = nullptr;
  EXPECT_EQ(sqlite3_open(path.c_str(), &database), SQLITE_OK);
  const std::string tables =
      before +
      "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
      "serialization_format TEXT NOT NULL);"
      "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "
      "timestamp INTEGER NOT NULL, data BLOB NOT NULL);";
  EXPECT_EQ(sqlite3_exec(database, tables.c_str(), nullptr, nullptr, nullptr), SQLITE_OK);
  const auto insert = [&](const char* sql, const std::vector<std::string>& values) {
    sqlite3_stmt* statement = nullptr;
    EXPECT_EQ(sqlite3_prepare_v2(database, sql, -1, &statement, nullptr), SQLITE_OK);
    for (std::size_t i = 0; i < values.size(); ++i) {
      const int place = static_cast<int>(i) + 1, size = static_cast<int>(values[i].size());
      if (values.size() == 1)
        sqlite3_bind_blob(statement, place, values[i].data(), size, SQLITE_STATIC);
      else
        sqlite3_bind_text(statement, place, values[i].data(), size, SQLITE_STATIC);
    }
    EXPECT_EQ(sqlite3_step(statement), SQLITE_DONE);
    sqlite3_finalize(statement);
  };
  for (const Db3Message& message : messages) {
    insert("INSERT INTO topics(name, type, serialization_format) VALUES(?, ?, 'cdr')",
           {message.topic, message.type});
    insert("INSERT INTO messages(topic_id, timestamp, data) SELECT max(id), 1, ? FROM topics",
           {message.data});
  }
  sqlite3_close(database);
  return path;
}

/// A bag with one message of sensor_msgs/msg/Image on /camera/depth.
std::vector<RecordedDepth> ReadDb3(const Picture& picture) {
  const TempFolder folder;
  return ReadRecording(
      WriteDb3(folder, {{"/camera/depth", "sensor_msgs/msg/Image", CdrMessage(picture)}}), 2);
}

std::string PackZstd(const std::string& content) {
  std::string packed(ZSTD_compressBound(content.size()), '\0');
  packed.resize(ZSTD_compress(packed.data(), packed.size(), content.data(), content.size(), 3));
  return packed;
}

std::string CdrText(const std::string& text) {
  CdrWriter writer;
  writer.AddText(text);
  return writer.bytes();
}

/// As librealsense 2.58 writes it, whose lens is a text.
std::vector<Db3Message> RealSense258() {
  const std::string stream = "/device_0/sensor_0/Depth_0", text = "std_msgs/msg/String";
  return {{stream + "/camera_info", text,
           CdrText("width=3;height=2;fx=2.5;ppx=1.25;fy=2.25;ppy=0.5;model=Brown Conrady;"
                   "coeffs=0,0,0,0,0")},
          {"/device_0/info", text, CdrText("Name=Intel RealSense D415;Serial Number=7")},
          {"/device_0/sensor_0/option/Depth_Units/value", text, CdrText("0.000100")},
          {stream + "/image/data", "sensor_msgs/msg/Image",
           CdrMessage({"mono16", false, Samples(false)})},
          {stream + "/tf/ref_1", text,
           CdrText("rotation=1,0,0,0,1,0,0,0,1;translation=0.000000,0.000000,0.000000")}};
}

TEST(DescribedDb3, MessagesAndFilesThatZstdPacked) {
  const TempFolder folder;
  std::vector<Db3Message> packed = RealSense258();
  for (Db3Message& message : packed) message.data = PackZstd(message.data);
  const std::string plain = ReadFile(WriteDb3(folder, RealSense258()));
  const auto whole = folder.Write("a.db3.zstd", PackZstd(plain));
  EXPECT_TRUE(IsRecording(whole));
  for (const std::filesystem::path& path :
       {whole, folder.Write("plain.db3", plain), std::filesystem::path(WriteDb3(folder, packed))}) {
    SCOPED_TRACE(path.string());
    const auto streams = ReadRecording(path, 2);
    ExpectDepth(streams, "/device_0/sensor_0/Depth_0/image/data", 0.0001, 1);
    ASSERT_TRUE(streams[0].intrinsics) << streams[0].intrinsics_problem;
    EXPECT_EQ(*streams[0].intrinsics,
              (Intrinsics{kWidth, kHeight, 2.5, 2.25, 1.25, 0.5, std::vector<double>(5, 0.0)}));
    EXPECT_EQ(streams[0].kind, "realsense_d415");
    EXPECT_EQ(streams[0].serial, "7");
  }
  // Cut off, it is none; a picture that zstd packed is none either.
  folder.Write("cut.db3.zstd", ReadFile(whole).substr(0, ReadFile(whole).size() - 9));
  ExpectError<DataError>([&] { ReadRecording(folder / "cut.db3.zstd", 2); },
                         {"cut.db3.zstd", "zstd"});
  EXPECT_FALSE(IsRecording(folder.Write("a.zst", PackZstd("P5 1 1 255 x"))));
}

// The images of one stream, before and after they were compressed.
TEST(DescribedDb3, ImagesAreNotReadTwice) {
  const TempFolder folder;
  CdrWriter compressed;
  AddCdrHeader("camera", &compressed);
  compressed.AddText("16UC1; compressedDepth rvl");
  compressed.AddBytes("none that is read");
  const Db3Message images = {"/camera/depth/image", "sensor_msgs/msg/Image", CdrMessage()};
  const Db3Message others = {"/camera/depth/image/compressedDepth",
                             "sensor_msgs/msg/CompressedImage", compressed.bytes()};
  for (const auto& both : {std::vector{images, others}, std::vector{others, images}})
    ExpectDepth(ReadRecording(WriteDb3(folder, both), 10), images.topic, 0.001, 1);
  ExpectError<DataError>([&] { ReadRecording(WriteDb3(folder, {others}), 10); },
                         {"a.db3", "/camera/depth/image", "rvl", "PNG", "image_transport"});
  // Beside a camera that can be read, it is said of the stream.
  Db3Message second = images;
  second.topic = "/other/depth/image";
  const auto streams = ReadRecording(WriteDb3(folder, {others, second}), 10);
  ASSERT_EQ(streams.size(), 2u);
  EXPECT_TRUE(Has(streams[0].problem, "rvl"));
  EXPECT_EQ(streams[1].frames.size(), 1u);
}

// What a recorder left that was stopped: a write-ahead log. Reading leaves nothing behind, and
// needs no right to write.
TEST(DescribedDb3, AWriteAheadLogIsReadAndLeftAsItIs) {
  const TempFolder made, folder;
  const std::string path = (folder / "a.db3").string();
  {
    const std::string with_log =
        WriteDb3(made, {}, "PRAGMA journal_mode=WAL; PRAGMA wal_autocheckpoint=0;");
    sqlite3* database = nullptr;
    ASSERT_EQ(sqlite3_open(with_log.c_str(), &database), SQLITE_OK);
    const std::string sql =
        "PRAGMA wal_autocheckpoint=0;"
        "INSERT INTO topics VALUES(1, '/x', 'std_msgs/msg/String', 'cdr');"
        "INSERT INTO messages VALUES(1, 1, 1, x'00010000020000006100');";
    ASSERT_EQ(sqlite3_exec(database, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK);
    // As they are while the recorder runs.
    folder.Write("a.db3", ReadFile(with_log));
    folder.Write("a.db3-wal", ReadFile(with_log + "-wal"));
    sqlite3_close(database);
  }
  const std::string log = ReadFile(path + "-wal");
  ASSERT_FALSE(log.empty());
  std::filesystem::permissions(
      folder.path(), std::filesystem::perms::owner_read | std::filesystem::perms::owner_exec);
  ExpectError<DataError>([&] { ReadRecording(path, 2); }, {"no depth stream", "/x (std_msgs"});
  std::filesystem::permissions(folder.path(), std::filesystem::perms::owner_all);
  EXPECT_EQ(ReadFile(path + "-wal"), log);
  const auto files = std::filesystem::directory_iterator(folder.path());
  EXPECT_EQ(std::distance(begin(files), end(files)), 2);
  // Where the log is gone, the database still says that it had one.
  std::filesystem::remove(path + "-wal");
  ExpectError<DataError>([&] { ReadRecording(path, 2); }, {"a.db3"});
  EXPECT_FALSE(std::filesystem::exists(path + "-wal"));
  // A journal would have to be played back.
  folder.Write("a.db3-journal", "\xd9\xd5\x05\xf9\x20\xa1\x63\xd7 and more");
  ExpectError<DataError>([&] { ReadRecording(path, 2); }, {"a.db3", "journal", "sqlite3"});
}

TEST(DescribedDb3, ATextIsBounded) {
  const TempFolder folder;
  const auto expect = [&](const std::vector<Db3Message>& messages, const std::string& part) {
    ExpectError<DataError>([&] { ReadRecording(WriteDb3(folder, messages), 2); }, {"a.db3", part});
  };
  const Db3Message depth = RealSense258()[3];
  std::string long_text = "rotation=";
  for (int i = 0; i < 100000; ++i) long_text += "1,";
  expect(
      {depth, {"/device_0/sensor_0/Depth_0/tf/ref_1", "std_msgs/msg/String", CdrText(long_text)}},
      "a text of");
  expect({{"/" + std::string(2000, 'a'), depth.type, depth.data}}, "a text of 2001 bytes");
}

TEST(DescribedDb3, PlainImages) {
  ExpectDepth(ReadDb3(Plain()), "/camera/depth", 0.001, 1);
  ExpectDepth(ReadDb3({"16UC1", true, Samples(true)}), "/camera/depth", 0.001, 1);
  ExpectDepth(ReadDb3({"mono16", false, Samples(false)}), "/camera/depth", 0.001, 1);
  ExpectDepth(ReadDb3({"32FC1", false, Metres()}), "/camera/depth", 1, 0.001);
}

// MCAP (mcap.dev/spec).

std::uint32_t Crc(const std::string& bytes) {  // bit by bit, as IEEE 802.3 has it
  std::uint32_t crc = ~0U;
  for (const char byte : bytes) {
    for (int bit = 0; bit < 8; ++bit) {
      const std::uint32_t low = (crc ^ (static_cast<std::uint8_t>(byte) >> bit)) & 1;
      crc = crc >> 1 ^ (low != 0 ? 0xEDB88320U : 0);
    }
  }
  return ~crc;
}

std::string McapRecord(char opcode, const std::string& content) {
  return opcode + Bytes(std::uint64_t{content.size()}) + content;
}

/// A message on a channel, whose number is also that of its schema.
std::string McapStream(const std::string& schema, const std::string& encoding,
                       const std::string& message, const std::string& topic = "/camera/depth",
                       std::uint16_t number = 9) {
  return McapRecord(3, Bytes(number) + Block(schema) + Block("x") + Block("")) +
         McapRecord(4, Bytes(number) + Bytes(number) + Block(topic) + Block(encoding) + Block("")) +
         McapRecord(5, Bytes(number) + std::string(20, '\0') + message);
}

std::string Mcap(const std::string& records) {
  return "\x89MCAP0\r\n" + McapRecord(1, Block("") + Block("test")) + records;
}

std::string McapChunk(const std::string& records, const std::string& compression,
                      const std::string& packed, std::uint32_t crc) {
  return McapRecord(6, std::string(16, '\0') + Bytes(std::uint64_t{records.size()}) + Bytes(crc) +
                           Block(compression) + Bytes(std::uint64_t{packed.size()}) + packed);
}

TEST(DescribedMcap, MessagesOfBothRosAndChunksOfAllKinds) {
  const TempFolder folder;
  const std::string ros1 = McapStream("sensor_msgs/Image", "ros1", RosMessage());
  const std::string ros2 = McapStream("sensor_msgs/msg/Image", "cdr", CdrMessage());
  for (const std::string& records : {ros1, ros2}) {
    for (const std::string& file :
         {Mcap(records), Mcap(McapChunk(records, "", records, Crc(records))),
          Mcap(McapChunk(records, "zstd", PackZstd(records), Crc(records))),
          Mcap(McapChunk(records, "lz4", PackLz4(records), 0))}) {
      ExpectDepth(ReadRecording(folder.Write("a.mcap", file), 2), "/camera/depth", 0.001, 1);
    }
  }
}

TEST(DescribedMcap, CameraAndColourCameraOfRos2) {
  const auto stream = [](std::uint16_t number, const std::string& topic, const std::string& type,
                         const std::string& message) {
    return McapStream(type, "cdr", message, topic, number);
  };
  const double half = std::sqrt(0.5);
  const std::string records =
      stream(1, "/tf_static", "tf2_msgs/msg/TFMessage",
             CdrLink("camera_link", "depth_frame", {0, 0, 0.5, 0, 0, 0, 1})) +
      stream(2, "/tf_static", "tf2_msgs/msg/TFMessage",
             CdrLink("camera_link", "color_frame", {0.1, 0, 0, 0, 0, half, half})) +
      stream(3, "/camera/color/camera_info", "sensor_msgs/msg/CameraInfo",
             CdrCamera("color_frame", 3)) +
      stream(4, "/camera/depth/camera_info", "sensor_msgs/msg/CameraInfo",
             CdrCamera("depth_frame", 2)) +
      stream(5, "/camera/depth/image_raw", "sensor_msgs/msg/Image", CdrMessage());
  const TempFolder folder;
  for (const std::string& file :
       {Mcap(records), Mcap(McapChunk(records, "zstd", PackZstd(records), Crc(records)))}) {
    const auto streams = ReadRecording(folder.Write("a.mcap", file), 1);
    ExpectDepth(streams, "/camera/depth/image_raw", 0.001, 1);
    ASSERT_TRUE(streams[0].intrinsics && streams[0].colour && streams[0].colour->intrinsics);
    EXPECT_EQ(*streams[0].intrinsics,
              (Intrinsics{kWidth, kHeight, 2, 2, 1, 0.5, {0.1, 0.2, 0.01, 0.02, 0.3}}));
    EXPECT_EQ(streams[0].colour->intrinsics->fx, 3);
    ExpectSeenByColour(streams, {2, -0.9, 3.5});  // as of ColourCameraByStaticTransforms
  }
}

TEST(DescribedMcap, MessagesOfOrbbec) {
  const auto stream = [](std::uint16_t number, const std::string& topic, const std::string& type,
                         const std::string& message) {
    return McapStream(type, "ros1", message, topic, number);
  };
  const std::string records =
      stream(1, "/cam/property", "custom_msg/property", OrbbecProperty(176, 0.1F)) +
      stream(2, kOrbbecDepth, "sensor_msgs/Image", OrbbecImage("mono16")) +
      stream(3, "/cam/deviceInfo", "custom_msg/DeviceInfo",
             MessageHeader() + Block("Orbbec Gemini 335")) +
      stream(4, "/cam/streamProfileType_3", "custom_msg/StreamProfileInfo", OrbbecProfile({}));
  const TempFolder folder;
  const auto streams = ReadRecording(folder.Write("a.mcap", Mcap(records)), 1);
  ExpectDepth(streams, kOrbbecDepth, 0.0001, 1);
  EXPECT_EQ(streams[0].kind, "orbbec_gemini_335");
  ASSERT_TRUE(streams[0].intrinsics && streams[0].colour);
  EXPECT_EQ(streams[0].intrinsics->fy, 2.25);
}

TEST(DescribedMcap, ManyStreamsOfLongNames) {
  std::string records;
  for (std::uint16_t i = 1; i < 500; ++i)
    records += McapStream("sensor_msgs/Image", "ros1", RosMessage(),
                          fmt::format("/{:0>200}\x1b/depth/image", i), i);
  const TempFolder folder;
  folder.Write("a.mcap", Mcap(records));
  const std::string capture =
      folder.Write("capture.json", R"({"sensors": [{"name": "A", "depth": "a.mcap"}]})");
  const std::string said =
      ExpectError<DataError>([&] { ReadCapture(capture); }, {"several depth streams"});
  EXPECT_LT(said.size(), 600u) << said;
  EXPECT_FALSE(Has(said, "\x1b"));
}

TEST(DescribedMcap, DamagedOrUnknown) {
  const TempFolder folder;
  const std::string records = McapStream("sensor_msgs/msg/Image", "cdr", CdrMessage());
  const auto read = [&](const std::string& bytes) {
    return ReadRecording(folder.Write("a.mcap", bytes), 2);
  };
  const auto expect = [&](const std::string& of, const std::string& part) {
    ExpectError<DataError>([&] { read(Mcap(of)); }, {"a.mcap", part});
  };
  expect(McapChunk(records, "", records, Crc(records) + 1), "CRC-32");
  expect(McapChunk(records, "brotli", records, 0), "brotli");
  expect(McapChunk(records, "brotli", records, 0), "zstd and lz4");
  expect(McapChunk(records, "zstd", records, 0), "damaged");
  expect(McapStream("my.Image", "protobuf", "x"), "/camera/depth (my.Image, encoded as protobuf)");
  // Cut off within its last chunk, what stands before is read.
  const std::string file = Mcap(records + McapChunk(records, "", records, 0));
  ExpectDepth(read(file.substr(0, file.size() - 9)), "/camera/depth", 0.001, 1);
}

TEST(DescribedMcap, ManyChunksOfZeros) {
  const std::string zeros(std::size_t{1} << 20, '\0');
  const std::string records = McapStream("x", "ros1", zeros, "/x");
  std::string chunks;
  for (int i = 0; i < 60; ++i) chunks += McapChunk(records, "zstd", PackZstd(records), 0);
  const TempFolder folder;
  ReadBudget budget(std::uint64_t{1} << 24);
  ExpectError<DataError>([&] { ReadRecording(folder.Write("a.mcap", Mcap(chunks)), 1, &budget); },
                         {"a.mcap", "unpacked"});
}

// Matroska (RFC 9559).

/// An element with a size of eight bytes.
std::string Element(const std::string& id, const std::string& data) {
  std::string bytes = id + '\x01';
  for (int byte = 6; byte >= 0; --byte)
    bytes += static_cast<char>(std::uint64_t{data.size()} >> (8 * byte));
  return bytes + data;
}

/// BITMAPINFOHEADER up to biCompression, and zeros.
std::string BitmapHeader(const std::string& compression) {
  return Bytes<std::uint32_t>(40) + Bytes<std::int32_t>(kWidth) + Bytes<std::int32_t>(kHeight) +
         Bytes<std::uint16_t>(1) + Bytes<std::uint16_t>(16) + compression + std::string(20, '\0');
}

/// One frame of a track whose codec and own elements are given; in a BlockGroup or a SimpleBlock.
std::string Mkv(const std::string& codec, const std::string& of_track, const std::string& of_video,
                const std::string& frame, bool group) {
  const std::string number = "\x01", width(1, kWidth), height(1, kHeight);
  const std::string video =
      Element("\xE0", Element("\xB0", width) + Element("\xBA", height) + of_video);
  const std::string track =
      Element("\xAE", Element("\xD7", number) + Element("\x73\xC5", number) +
                          Element("\x83", number) + Element("\x86", codec) + of_track + video);
  const std::string block = std::string("\x81\x00\x00\x00", 4) + frame;
  const std::string cluster =
      Element("\xE7", std::string(1, '\0')) +
      (group ? Element("\xA0", Element("\xA1", block)) : Element("\xA3", block));
  return Element("\x1A\x45\xDF\xA3", Element("\x42\x82", "matroska")) +
         Element("\x18\x53\x80\x67",
                 Element("\x16\x54\xAE\x6B", track) + Element("\x1F\x43\xB6\x75", cluster));
}

TEST(DescribedMkv, GreyOf16BitsInBothByteOrdersAndBlocks) {
  const TempFolder folder;
  for (const bool group : {true, false}) {
    for (const auto& [fourcc, big_endian] : {std::pair("Y16 ", false), std::pair("b16g", true)}) {
      for (const bool vfw : {true, false}) {
        SCOPED_TRACE(fourcc);
        const std::string bytes =
            vfw ? Mkv("V_MS/VFW/FOURCC", Element("\x63\xA2", BitmapHeader(fourcc)), "",
                      Samples(big_endian), group)
                : Mkv("V_UNCOMPRESSED", "", Element("\x2E\xB5\x24", fourcc), Samples(big_endian),
                      group);
        const std::vector<RecordedDepth> streams = ReadRecording(folder.Write("a.mkv", bytes), 2);
        ASSERT_EQ(streams.size(), 1u);
        // Nothing says that the device is a Kinect, whose unit would be known.
        EXPECT_FALSE(streams[0].depth_scale.has_value());
        EXPECT_FALSE(streams[0].intrinsics.has_value());
        ASSERT_EQ(streams[0].frames.size(), 1u);
        for (std::size_t i = 0; i < streams[0].frames[0].values.size(); ++i)
          EXPECT_EQ(streams[0].frames[0].values[i], static_cast<float>(kDepth[i])) << i;
      }
    }
  }
}

// libebml takes what it did not get for read.
TEST(DescribedMkv, AnElementThatEndsBehindTheFile) {
  const TempFolder folder;
  const std::string whole =
      Mkv("V_UNCOMPRESSED", "", Element("\x2E\xB5\x24", "b16g"), Samples(true), true);
  const std::string cut = whole.substr(0, whole.find("b16g") + 1);
  ExpectError<DataError>([&] { ReadRecording(folder.Write("a.mkv", cut), 2); },
                         {"a.mkv", "damaged", "4 bytes ends behind the file"});
}

}  // namespace
}  // namespace volalign::described_recordings_test
