// Forms of recordings that no file in this folder has, each written here from its format's
// description.

#include <bzlib.h>
#include <gtest/gtest.h>
#include <lz4frame.h>
#include <sqlite3.h>
#include <zstd.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "infer/formats/recording.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/infer/formats/bag_writer.h"

namespace volalign::described_recordings_test {
namespace {

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

// Bags of ROS 1.

/// sensor_msgs/Image, serialised (wiki.ros.org/msg): little-endian, without padding.
std::string RosMessage(const Picture& picture) {
  using bag_writer::Block;
  using bag_writer::Bytes;
  return std::string(12, '\0') + Block("camera") + Bytes<std::uint32_t>(kHeight) +
         Bytes<std::uint32_t>(kWidth) + Block(picture.encoding) +
         static_cast<char>(picture.big_endian) + Bytes(Step(picture)) + Block(picture.data);
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

std::vector<RecordedDepth> ReadBag(const Picture& picture, const std::string& compression) {
  const TempFolder folder;
  const std::string content = bag_writer::Connection(0, "/camera/depth", "sensor_msgs/Image") +
                              bag_writer::Message(0, RosMessage(picture));
  const std::string packed = compression == "bz2"   ? PackBz2(content)
                             : compression == "lz4" ? PackLz4(content)
                                                    : content;
  return ReadRecording(
      folder.Write("a.bag", bag_writer::Bag(bag_writer::PackedChunk(content, compression, packed))),
      2);
}

TEST(DescribedBag, ChunksOfAllKinds) {
  for (const char* compression : {"none", "bz2", "lz4"}) {
    SCOPED_TRACE(compression);
    ExpectDepth(ReadBag({"16UC1", false, Samples(false)}, compression), "/camera/depth", 0.001, 1);
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

template <class T>
std::string Many(const std::vector<T>& values) {
  std::string bytes;
  for (const T value : values) bytes += bag_writer::Bytes(value);
  return bytes;
}

struct OrbbecProfileFields {
  std::uint8_t type = 3, model = 4;
  std::vector<float> rotation = {0, -1, 0, 1, 0, 0, 0, 0, 1}, translation = {-32, 2, 4};
  std::vector<float> lens = {16.17F, 8.45F, 0.324F, 16.48F, 13.94F, 1.996F, 6e-5F, -1.5e-5F};
};

std::string OrbbecProfile(const OrbbecProfileFields& fields) {
  return std::string(12, '\0') + bag_writer::Block("") + static_cast<char>(fields.type) + '\x01' +
         Many(fields.rotation) + Many(fields.translation) +
         Many<std::uint16_t>({kWidth, kHeight, 30}) + Many<float>({2.5F, 2.25F, 1.5F, 0.5F}) +
         Many(fields.lens) + static_cast<char>(fields.model);
}

/// SDKs before pixel_bit_size end with the size of the metadata.
std::string OrbbecImage(const std::string& encoding, bool older_sdk = false) {
  return RosMessage({encoding, false, Samples(false)}) + Many<float>({0}) +
         Many<std::uint64_t>({7, 1, 2, 3}) + bag_writer::Block("meta") + Many<std::uint32_t>({4}) +
         (older_sdk ? "" : "\x10");
}

/// custom_msg/property.
template <class T>
std::string OrbbecProperty(std::uint32_t number, T value) {
  using namespace bag_writer;
  return Message(5, std::string(12, '\0') + Block("") + Bytes(number) + Block(Bytes(value)) +
                        Bytes(std::uint32_t{sizeof(T)}));
}

std::string OrbbecBag(const std::string& encoding, const OrbbecProfileFields& profile,
                      const std::string& device = "Orbbec Femto Bolt",
                      const std::string& properties = "") {
  using namespace bag_writer;
  OrbbecProfileFields colour;
  colour.type = 2;
  colour.model = 3;
  return Bag(Chunk(Connection(5, "/cam/property", "custom_msg/property") + properties +
                   Connection(0, "/cam/sensor_1/frameType_1", "sensor_msgs/Image") +
                   Message(0, OrbbecImage("mono16")) +
                   Connection(1, "/cam/sensor_3/frameType_3", "sensor_msgs/Image") +
                   Message(1, OrbbecImage(encoding)) +
                   Connection(2, "/cam/deviceInfo", "custom_msg/DeviceInfo") +
                   Message(2, std::string(12, '\0') + Block("") + Block(device) + Block("more")) +
                   Connection(3, "/cam/streamProfileType_3", "custom_msg/StreamProfileInfo") +
                   Message(3, OrbbecProfile(profile)) +
                   Connection(4, "/cam/streamProfileType_2", "custom_msg/StreamProfileInfo") +
                   Message(4, OrbbecProfile(colour))));
}

TEST(OrbbecBag, DepthWithItsLensAndColourCamera) {
  const TempFolder folder;
  for (const char* encoding : {"mono16", "z16"}) {
    const auto streams =
        ReadRecording(folder.Write("a.bag", OrbbecBag(encoding, {})), 2);  // infrared is none
    ExpectDepth(streams, "/cam/sensor_3/frameType_3", 0.001, 1);
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
    ASSERT_TRUE(streams[0].colour);
    const Eigen::Vector3d p = streams[0].colour->colour_from_depth * Eigen::Vector3d(1, 2, 3);
    EXPECT_LT((p - Eigen::Vector3d(-2 - 0.032, 1 + 0.002, 3.004)).norm(), 1e-6);
    ASSERT_TRUE(streams[0].colour->intrinsics);
    EXPECT_EQ(streams[0].colour->intrinsics->fx, 2.5);
  }
}

TEST(OrbbecBag, WhatItDoesNotKnowItNames) {
  const TempFolder folder;
  const auto read = [&](const std::string& bytes) {
    return ReadRecording(folder.Write("a.bag", bytes), 2);
  };
  ExpectError<DataError>([&] { read(OrbbecBag("RVL", {})); }, {"a.bag", "RVL", "frameType_3"});
  OrbbecProfileFields fisheye;
  fisheye.model = 5;
  ExpectError<DataError>([&] { read(OrbbecBag("z16", fisheye)); }, {"a.bag", "lens model 5"});
  OrbbecProfileFields rectified;
  rectified.lens.assign(8, 0);
  rectified.model = 1;
  rectified.rotation.assign(9, 0);
  const auto plain = read(OrbbecBag("z16", rectified, "Orbbec Gemini 2"));
  EXPECT_EQ(plain[0].intrinsics->distortion, std::vector<double>(5, 0.0));
  EXPECT_FALSE(plain[0].colour);
  EXPECT_FALSE(plain[0].depth_scale) << "no property states the unit of this Gemini";
}

// Numbers of properties and levels: include/libobsensor/h/Property.h and ObTypes.h of OrbbecSDK v2;
// src/media/record/RecordDevice.cpp records them before the first frame.
TEST(OrbbecBag, UnitAmongTheProperties) {
  const TempFolder folder;
  const auto read = [&](const std::string& device, const std::string& properties) {
    return ReadRecording(folder.Write("a.bag", OrbbecBag("mono16", {}, device, properties)), 2);
  };
  const std::string topic = "/cam/sensor_3/frameType_3";
  const std::string other = OrbbecProperty<std::int32_t>(14, 6);  // not the unit
  ExpectDepth(read("Orbbec Gemini 335", other + OrbbecProperty(176, 0.25F)), topic, 0.00025, 1);
  const double levels[] = {0.001, 0.0008, 0.0004, 0.0001, 0.0002, 0.0005, 0.00005};
  for (std::int32_t level = 0; level < 7; ++level)
    ExpectDepth(read("Orbbec Gemini 2", OrbbecProperty(75, level) + other), topic, levels[level],
                1);
  EXPECT_FALSE(read("Orbbec Gemini 2", OrbbecProperty<std::int32_t>(75, 7))[0].depth_scale)
      << "a level that no SDK has named";
  EXPECT_FALSE(read("Orbbec Gemini 335", OrbbecProperty(176, 0.0F))[0].depth_scale);
  ExpectDepth(read("Orbbec Femto Mega", OrbbecProperty<std::int32_t>(75, 3)), topic, 0.001, 1);
  // The device makes depth of its disparities, or leaves it to the SDK on playback.
  ExpectDepth(read("Orbbec Gemini 335", OrbbecProperty(85, '\1') + OrbbecProperty(176, 1.0F)),
              topic, 0.001, 1);
  ExpectError<DataError>([&] { read("Orbbec Gemini 335", OrbbecProperty(85, '\0')); },
                         {"a.bag", "frameType_3", "disparities"});
}

TEST(OrbbecBag, OlderLayouts) {
  using namespace bag_writer;
  const TempFolder folder;
  const auto read = [&](const std::string& topic, const std::string& image) {
    return ReadRecording(
        folder.Write(
            "a.bag",
            Bag(Chunk(Connection(0, topic, "sensor_msgs/Image") + Message(0, image) +
                      Connection(1, "/cam/deviceInfo", "custom_msg/DeviceInfo") +
                      Message(1, std::string(12, '\0') + Block("") + Block("Orbbec Femto Bolt"))))),
        2);
  };
  const std::string topic = "/cam/sensor_3/frameType_3";
  ExpectDepth(read(topic, OrbbecImage("mono16", /*older_sdk=*/true)), topic, 0.001, 1);
  // OrbbecViewer 1 (OrbbecSDK issue 195 shows its /cam0/color_raw).
  ExpectDepth(read("/cam0/depth_raw", OrbbecImage("mono16", true)), "/cam0/depth_raw", 0.001, 1);
}

TEST(DescribedBag, WithoutDepthSaysWhatIsInIt) {
  using namespace bag_writer;
  const TempFolder folder;
  const std::string bag =
      Bag(Chunk(Connection(0, "/camera/color", "sensor_msgs/Image") +
                Message(0, RosMessage({"rgb8", false,
                                       std::string(std::size_t{3} * kWidth * kHeight, 'x')}))));
  ExpectError<DataError>([&] { ReadRecording(folder.Write("a.bag", bag), 2); },
                         {"no depth stream", "/camera/color (sensor_msgs/Image)"});
}

/// sensor_msgs/CameraInfo of ROS 1, of that frame.
std::string RosCamera(const std::string& frame, double fx,
                      const std::vector<double>& lens = std::vector<double>(5, 0.0)) {
  const std::string d = bag_writer::Bytes(static_cast<std::uint32_t>(lens.size())) + Many(lens);
  return std::string(12, '\0') + bag_writer::Block(frame) + Many<std::uint32_t>({kHeight, kWidth}) +
         bag_writer::Block("plumb_bob") + d + Many<double>({fx, 0, 1, 0, fx, 0.5, 0, 0, 1}) +
         Many<double>({1, 0, 0, 0, 1, 0, 0, 0, 1}) +
         Many<double>({fx, 0, 1, 0, 0, fx, 0.5, 0, 0, 0, 1, 0});
}

/// geometry_msgs/TransformStamped.
std::string RosLink(const std::string& parent, const std::string& child,
                    const std::vector<double>& translation_and_quaternion) {
  return std::string(12, '\0') + bag_writer::Block(parent) + bag_writer::Block(child) +
         Many(translation_and_quaternion);
}

// camera_link carries both cameras: the colour one 10 cm along its x and turned by a quarter about
// its z.
TEST(DescribedBag, ColourCameraByStaticTransforms) {
  using namespace bag_writer;
  const double half = std::sqrt(0.5);
  const std::string links = Bytes<std::uint32_t>(2) +
                            RosLink("camera_link", "depth_frame", {0, 0, 0.5, 0, 0, 0, 1}) +
                            RosLink("camera_link", "color_frame", {0.1, 0, 0, 0, 0, half, half});
  const std::string bag =
      Bag(Chunk(Connection(0, "/camera/depth/image_raw", "sensor_msgs/Image") +
                Message(0, RosMessage({"16UC1", false, Samples(false)})) +
                Connection(1, "/camera/depth/camera_info", "sensor_msgs/CameraInfo") +
                Message(1, RosCamera("depth_frame", 2)) +
                Connection(2, "/camera/color/camera_info", "sensor_msgs/CameraInfo") +
                Message(2, RosCamera("color_frame", 3)) +
                Connection(3, "/tf_static", "tf2_msgs/TFMessage") + Message(3, links)));
  const TempFolder folder;
  const auto streams = ReadRecording(folder.Write("a.bag", bag), 1);
  ASSERT_EQ(streams.size(), 1u);
  ASSERT_TRUE(streams[0].colour);
  EXPECT_EQ(streams[0].intrinsics->fx, 2);
  EXPECT_EQ(streams[0].colour->intrinsics->fx, 3);
  // (1, 2, 3) of the depth frame is (1, 2, 3.5) of the link; less 0.1 along x, turned back.
  const Eigen::Vector3d p = streams[0].colour->colour_from_depth * Eigen::Vector3d(1, 2, 3);
  EXPECT_LT((p - Eigen::Vector3d(2, -0.9, 3.5)).norm(), 1e-9);
}

// Orbbec's ROS wrapper calls its rational lens plumb_bob: with eight coefficients it is OpenCV's.
TEST(DescribedBag, PlumbBobOfEightCoefficientsIsRational) {
  using namespace bag_writer;
  const std::vector<double> lens = {16.17, 8.45, 6e-5, -1.5e-5, 0.324, 16.48, 13.94, 1.996};
  const TempFolder folder;
  const auto streams = ReadRecording(
      folder.Write("a.bag",
                   Bag(Chunk(Connection(0, "/camera/depth/image_raw", "sensor_msgs/Image") +
                             Message(0, RosMessage({"16UC1", false, Samples(false)})) +
                             Connection(1, "/camera/depth/camera_info", "sensor_msgs/CameraInfo") +
                             Message(1, RosCamera("depth_frame", 2, lens))))),
      1);
  ASSERT_EQ(streams.size(), 1u);
  ASSERT_TRUE(streams[0].intrinsics);
  EXPECT_EQ(streams[0].intrinsics->distortion, lens);
}

// librealsense's recorder says where the reference stream is in each stream's frame.
TEST(DescribedBag, ColourCameraOfRealSense) {
  using namespace bag_writer;
  const double half = std::sqrt(0.5);
  const std::string depth = "/device_0/sensor_0/Depth_0", colour = "/device_0/sensor_1/Color_0";
  const std::string bag = Bag(Chunk(
      Connection(0, depth + "/image/data", "sensor_msgs/Image") +
      Message(0, RosMessage({"mono16", false, Samples(false)})) +
      Connection(1, depth + "/info/camera_info", "sensor_msgs/CameraInfo") +
      Message(1, RosCamera("", 2)) +
      Connection(2, colour + "/info/camera_info", "sensor_msgs/CameraInfo") +
      Message(2, RosCamera("", 3)) + Connection(3, depth + "/tf/0", "geometry_msgs/Transform") +
      Message(3, Many<double>({0, 0, 0, 0, 0, 0, 1})) +
      Connection(4, colour + "/tf/0", "geometry_msgs/Transform") +
      Message(4, Many<double>({0.015, 0, 0, half, 0, 0, half}))));
  const TempFolder folder;
  const auto streams = ReadRecording(folder.Write("a.bag", bag), 1);
  ASSERT_TRUE(streams[0].colour);
  const Eigen::Vector3d p = streams[0].colour->colour_from_depth * Eigen::Vector3d(1, 2, 3);
  EXPECT_LT((p - Eigen::Vector3d(1.015, -3, 2)).norm(), 1e-9);
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
std::string CdrMessage(const Picture& picture) {
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

/// A bag with one message of sensor_msgs/msg/Image on /camera/depth.
std::vector<RecordedDepth> ReadDb3(const Picture& picture) {
  const std::string message = CdrMessage(picture);
  const TempFolder folder;
  const std::string path = (folder / "a.db3").string();
  sqlite3* database = nullptr;
  EXPECT_EQ(sqlite3_open(path.c_str(), &database), SQLITE_OK);
  constexpr char kTables[] =
      "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
      "serialization_format TEXT NOT NULL);"
      "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "
      "timestamp INTEGER NOT NULL, data BLOB NOT NULL);"
      "INSERT INTO topics VALUES(1, '/camera/depth', 'sensor_msgs/msg/Image', 'cdr');";
  EXPECT_EQ(sqlite3_exec(database, kTables, nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_stmt* insert = nullptr;
  EXPECT_EQ(
      sqlite3_prepare_v2(database, "INSERT INTO messages VALUES(1, 1, 1, ?)", -1, &insert, nullptr),
      SQLITE_OK);
  sqlite3_bind_blob(insert, 1, message.data(), static_cast<int>(message.size()), SQLITE_STATIC);
  EXPECT_EQ(sqlite3_step(insert), SQLITE_DONE);
  sqlite3_finalize(insert);
  sqlite3_close(database);
  return ReadRecording(path, 2);
}

TEST(DescribedDb3, PlainImages) {
  ExpectDepth(ReadDb3({"16UC1", false, Samples(false)}), "/camera/depth", 0.001, 1);
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
  return opcode + bag_writer::Bytes(std::uint64_t{content.size()}) + content;
}

/// A message on a channel, whose number is also that of its schema.
std::string McapStream(const std::string& schema, const std::string& encoding,
                       const std::string& message, const std::string& topic = "/camera/depth",
                       std::uint16_t number = 9) {
  using bag_writer::Block;
  using bag_writer::Bytes;
  return McapRecord(3, Bytes(number) + Block(schema) + Block("x") + Block("")) +
         McapRecord(4, Bytes(number) + Bytes(number) + Block(topic) + Block(encoding) + Block("")) +
         McapRecord(5, Bytes(number) + std::string(20, '\0') + message);
}

std::string Mcap(const std::string& records) {
  return "\x89MCAP0\r\n" + McapRecord(1, bag_writer::Block("") + bag_writer::Block("test")) +
         records;
}

std::string McapChunk(const std::string& records, const std::string& compression,
                      const std::string& packed, std::uint32_t crc) {
  using bag_writer::Bytes;
  return McapRecord(6, std::string(16, '\0') + Bytes(std::uint64_t{records.size()}) + Bytes(crc) +
                           bag_writer::Block(compression) + Bytes(std::uint64_t{packed.size()}) +
                           packed);
}

std::string PackZstd(const std::string& content) {
  std::string packed(ZSTD_compressBound(content.size()), '\0');
  packed.resize(ZSTD_compress(packed.data(), packed.size(), content.data(), content.size(), 3));
  return packed;
}

TEST(DescribedMcap, MessagesOfBothRosAndChunksOfAllKinds) {
  const TempFolder folder;
  const std::string ros1 =
      McapStream("sensor_msgs/Image", "ros1", RosMessage({"16UC1", false, Samples(false)}));
  const std::string ros2 =
      McapStream("sensor_msgs/msg/Image", "cdr", CdrMessage({"16UC1", false, Samples(false)}));
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
      stream(5, "/camera/depth/image_raw", "sensor_msgs/msg/Image",
             CdrMessage({"16UC1", false, Samples(false)}));
  const TempFolder folder;
  for (const std::string& file :
       {Mcap(records), Mcap(McapChunk(records, "zstd", PackZstd(records), Crc(records)))}) {
    const auto streams = ReadRecording(folder.Write("a.mcap", file), 1);
    ExpectDepth(streams, "/camera/depth/image_raw", 0.001, 1);
    ASSERT_TRUE(streams[0].intrinsics && streams[0].colour && streams[0].colour->intrinsics);
    EXPECT_EQ(*streams[0].intrinsics,
              (Intrinsics{kWidth, kHeight, 2, 2, 1, 0.5, {0.1, 0.2, 0.01, 0.02, 0.3}}));
    EXPECT_EQ(streams[0].colour->intrinsics->fx, 3);
    // As of ColourCameraByStaticTransforms.
    const Eigen::Vector3d p = streams[0].colour->colour_from_depth * Eigen::Vector3d(1, 2, 3);
    EXPECT_LT((p - Eigen::Vector3d(2, -0.9, 3.5)).norm(), 1e-9);
  }
}

TEST(DescribedMcap, MessagesOfOrbbec) {
  using bag_writer::Block;
  using bag_writer::Bytes;
  const auto stream = [](std::uint16_t number, const std::string& topic, const std::string& type,
                         const std::string& message) {
    return McapStream(type, "ros1", message, topic, number);
  };
  const std::string records =
      stream(1, "/cam/property", "custom_msg/property",
             std::string(12, '\0') + Block("") + Bytes<std::uint32_t>(176) + Block(Bytes(0.1F)) +
                 Bytes<std::uint32_t>(4)) +
      stream(2, "/cam/sensor_3/frameType_3", "sensor_msgs/Image", OrbbecImage("mono16")) +
      stream(3, "/cam/deviceInfo", "custom_msg/DeviceInfo",
             std::string(12, '\0') + Block("") + Block("Orbbec Gemini 335")) +
      stream(4, "/cam/streamProfileType_3", "custom_msg/StreamProfileInfo", OrbbecProfile({}));
  const TempFolder folder;
  const auto streams = ReadRecording(folder.Write("a.mcap", Mcap(records)), 1);
  ExpectDepth(streams, "/cam/sensor_3/frameType_3", 0.0001, 1);
  EXPECT_EQ(streams[0].kind, "orbbec_gemini_335");
  ASSERT_TRUE(streams[0].intrinsics && streams[0].colour);
  EXPECT_EQ(streams[0].intrinsics->fy, 2.25);
}

TEST(DescribedMcap, DamagedOrUnknown) {
  const TempFolder folder;
  const std::string records =
      McapStream("sensor_msgs/msg/Image", "cdr", CdrMessage({"16UC1", false, Samples(false)}));
  const auto read = [&](const std::string& bytes) {
    return ReadRecording(folder.Write("a.mcap", bytes), 2);
  };
  ExpectError<DataError>([&] { read(Mcap(McapChunk(records, "", records, Crc(records) + 1))); },
                         {"a.mcap", "CRC-32"});
  ExpectError<DataError>([&] { read(Mcap(McapChunk(records, "brotli", records, 0))); },
                         {"a.mcap", "brotli", "zstd and lz4"});
  ExpectError<DataError>([&] { read(Mcap(McapChunk(records, "zstd", records, 0))); },
                         {"a.mcap", "damaged"});
  ExpectError<DataError>([&] { read(Mcap(McapStream("my.Image", "protobuf", "x"))); },
                         {"a.mcap", "/camera/depth (my.Image, encoded as protobuf)"});
  // Cut off within its last chunk, what stands before is read.
  const std::string file = Mcap(records + McapChunk(records, "", records, 0));
  ExpectDepth(read(file.substr(0, file.size() - 9)), "/camera/depth", 0.001, 1);
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
  return bag_writer::Bytes<std::uint32_t>(40) + bag_writer::Bytes<std::int32_t>(kWidth) +
         bag_writer::Bytes<std::int32_t>(kHeight) + bag_writer::Bytes<std::uint16_t>(1) +
         bag_writer::Bytes<std::uint16_t>(16) + compression + std::string(20, '\0');
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

}  // namespace
}  // namespace volalign::described_recordings_test
