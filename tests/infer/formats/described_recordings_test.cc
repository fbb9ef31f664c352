// Forms of recordings that no file in this folder has, each written here from its format's
// description.

#include <bzlib.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <lz4frame.h>
#include <sqlite3.h>
#include <zlib.h>
#include <zstd.h>

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <initializer_list>
#include <iterator>
#include <string>
#include <utility>
#include <vector>

#include "infer/capture/capture.h"
#include "infer/formats/read_budget.h"
#include "infer/formats/recording.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::described_recordings_test {
namespace {

using namespace formats_internal;

// Bags of ROS 1 (wiki.ros.org/Bags/Format/2.0), and databases.

template <class T>
std::string Bytes(T value) {
  return std::string(reinterpret_cast<const char*>(&value), sizeof(value));
}

std::string Block(const std::string& bytes) {
  return Bytes(static_cast<std::uint32_t>(bytes.size())) + bytes;
}

using Fields = std::initializer_list<std::pair<std::string, std::string>>;

std::string Header(const Fields& fields) {
  std::string bytes;
  for (const auto& [name, value] : fields) bytes += Block(name + "=" + value);
  return bytes;
}

std::string Record(const Fields& fields, const std::string& data) {
  return Block(Header(fields)) + Block(data);
}

std::string Connection(std::uint32_t number, const std::string& topic, const std::string& type) {
  return Record({{"op", "\x07"}, {"conn", Bytes(number)}, {"topic", topic}},
                Header({{"type", type}}));
}

std::string Message(std::uint32_t connection, const std::string& data) {
  return Record({{"op", "\x02"}, {"conn", Bytes(connection)}}, data);
}

/// A message on a connection of its own.
struct Topic {
  std::string name, type, data;
};
std::string Records(const std::vector<Topic>& topics) {
  std::string records;
  for (std::uint32_t i = 0; i < topics.size(); ++i)
    records += Connection(i, topics[i].name, topics[i].type) + Message(i, topics[i].data);
  return records;
}

/// What the messages of ROS 1 begin with.
std::string MessageHeader(const std::string& frame = "") {
  return std::string(12, '\0') + Block(frame);
}

/// `data` is `content` as `compression` packs it.
std::string PackedChunk(const std::string& content, const std::string& compression,
                        const std::string& data) {
  return Record({{"op", "\x05"},
                 {"compression", compression},
                 {"size", Bytes(static_cast<std::uint32_t>(content.size()))}},
                data);
}
std::string Chunk(const std::string& content, const std::string& compression = "none") {
  return PackedChunk(content, compression, content);
}

std::string Bag(const std::string& records) {
  const std::uint64_t no_index = 0;
  return "#ROSBAG V2.0\n" + Record({{"op", "\x03"}, {"index_pos", Bytes(no_index)}}, "") + records;
}

/// a.db3, anew, with what the statements make of it.
std::string WriteDatabase(const TempFolder& folder, const std::string& sql) {
  std::string path = (folder / "a.db3").string();
  std::filesystem::remove(path);
  sqlite3* database = nullptr;
  EXPECT_EQ(sqlite3_open(path.c_str(), &database), SQLITE_OK);
  EXPECT_EQ(sqlite3_exec(database, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(database);
  return path;
}

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

/// The same, with a byte behind each row that is not the picture's.
std::string Padded(const std::string& samples) {
  const std::size_t row = samples.size() / kHeight;
  return samples.substr(0, row) + 'x' + samples.substr(row) + 'x';
}

/// The same in metres, with `nothing` for what is no measurement.
std::string Metres(float nothing) {
  std::string bytes;
  for (const std::uint16_t value : kDepth) {
    const float metres = value == 0 ? nothing : 0.001F * value;
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

template <class T>
std::string Many(const std::vector<T>& values) {
  std::string bytes;
  for (const T value : values) bytes += Bytes(value);
  return bytes;
}

/// What is read of the bytes of a recording.
std::vector<RecordedDepth> ReadBytes(const std::string& name, const std::string& bytes,
                                     ReadBudget budget = ReadBudget(), int max_frames = 2) {
  const TempFolder folder;
  return ReadRecording(folder.Write(name, bytes), max_frames, &budget);
}

/// With a message that names the file.
void ExpectRefused(const std::string& name, const std::string& bytes,
                   std::initializer_list<std::string> parts) {
  EXPECT_TRUE(Has(ExpectError<DataError>([&] { ReadBytes(name, bytes); }, parts), name));
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

std::string PackZstd(const std::string& content) {
  std::string packed(ZSTD_compressBound(content.size()), '\0');
  packed.resize(ZSTD_compress(packed.data(), packed.size(), content.data(), content.size(), 3));
  return packed;
}

// Messages of ROS, whose fields are the same in both of its versions.

enum class Ros { k1, k2 };

/// ROS 1 (wiki.ros.org/msg): little-endian, without padding. ROS 2: CDR (OMG's DDSI-RTPS 2.5,
/// section 10), little-endian, each number aligned to its size, counted behind the header of four
/// bytes, and a zero behind each text.
class MessageWriter {
 public:
  explicit MessageWriter(Ros ros) : cdr_(ros == Ros::k2) {
    if (cdr_) bytes_ = std::string("\x00\x01\x00\x00", 4);
  }
  template <class T>
  MessageWriter& Add(T value) {
    while (cdr_ && (bytes_.size() - 4) % sizeof(T) != 0) bytes_ += '\0';
    bytes_ += Bytes(value);
    return *this;
  }
  MessageWriter& Add(const std::vector<double>& values) {
    for (const double value : values) Add(value);
    return *this;
  }
  MessageWriter& AddBytes(const std::string& bytes) {
    Add(static_cast<std::uint32_t>(bytes.size()));
    bytes_ += bytes;
    return *this;
  }
  MessageWriter& AddText(const std::string& text) { return AddBytes(cdr_ ? text + '\0' : text); }
  MessageWriter& AddHeader(const std::string& frame) {
    if (!cdr_) Add<std::uint32_t>(0);  // seq
    return Add<std::int32_t>(1700000000).Add<std::uint32_t>(0).AddText(frame);
  }
  const std::string& bytes() const { return bytes_; }

 private:
  bool cdr_;
  std::string bytes_;
};

Topic TopicOf(Ros ros, const std::string& name, const std::string& package, const std::string& type,
              const std::string& data) {
  return {name, package + (ros == Ros::k1 ? "/" : "/msg/") + type, data};
}

Topic ImageTopic(Ros ros, const std::string& name, const Picture& picture = Plain(),
                 const std::string& frame = "camera") {
  MessageWriter image(ros);
  image.AddHeader(frame).Add<std::uint32_t>(kHeight).Add<std::uint32_t>(kWidth);
  image.AddText(picture.encoding).Add(static_cast<std::uint8_t>(picture.big_endian));
  image.Add(static_cast<std::uint32_t>(picture.data.size() / kHeight)).AddBytes(picture.data);
  return TopicOf(ros, name, "sensor_msgs", "Image", image.bytes());
}

Topic CameraTopic(Ros ros, const std::string& name, const std::string& frame, double fx,
                  const std::vector<double>& lens = std::vector<double>(5, 0.0)) {
  MessageWriter info(ros);
  info.AddHeader(frame).Add<std::uint32_t>(kHeight).Add<std::uint32_t>(kWidth).AddText("plumb_bob");
  info.Add(static_cast<std::uint32_t>(lens.size())).Add(lens);
  info.Add({fx, 0, 1, 0, fx, 0.5, 0, 0, 1}).Add({1, 0, 0, 0, 1, 0, 0, 0, 1});
  info.Add({fx, 0, 1, 0, 0, fx, 0.5, 0, 0, 0, 1, 0});
  return TopicOf(ros, name, "sensor_msgs", "CameraInfo", info.bytes());
}

struct Link {
  std::string parent, child;
  std::vector<double> pose;  // translation, quaternion x y z w
};

Topic LinksTopic(Ros ros, const std::vector<Link>& links) {
  MessageWriter message(ros);
  message.Add(static_cast<std::uint32_t>(links.size()));
  for (const Link& link : links) message.AddHeader(link.parent).AddText(link.child).Add(link.pose);
  return TopicOf(ros, "/tf_static", "tf2_msgs", "TFMessage", message.bytes());
}

// Recordings of such topics.

std::string BagOf(const std::vector<Topic>& topics) { return Bag(Chunk(Records(topics))); }

std::vector<RecordedDepth> ReadBag(const std::vector<Topic>& topics) {
  return ReadBytes("a.bag", BagOf(topics));
}

// MCAP (mcap.dev/spec).

std::uint32_t Crc(const std::string& bytes) {
  return static_cast<std::uint32_t>(
      crc32(0, reinterpret_cast<const Bytef*>(bytes.data()), static_cast<uInt>(bytes.size())));
}

std::string McapRecord(char opcode, const std::string& content) {
  return opcode + Bytes(std::uint64_t{content.size()}) + content;
}

/// Each on a channel, whose number is also that of its schema.
std::string McapRecords(const std::vector<Topic>& topics, const std::string& encoding) {
  std::string records;
  for (const Topic& topic : topics) {
    const std::string number = Bytes(static_cast<std::uint16_t>(1 + &topic - topics.data()));
    records += McapRecord(3, number + Block(topic.type) + Block("x") + Block("")) +
               McapRecord(4, number + number + Block(topic.name) + Block(encoding) + Block("")) +
               McapRecord(5, number + std::string(20, '\0') + topic.data);
  }
  return records;
}

std::string Mcap(const std::string& records) {
  return "\x89MCAP0\r\n" + McapRecord(1, Block("") + Block("test")) + records;
}

std::string McapChunk(const std::string& records, const std::string& compression,
                      const std::string& packed, std::uint32_t crc) {
  return McapRecord(6, std::string(16, '\0') + Bytes(std::uint64_t{records.size()}) + Bytes(crc) +
                           Block(compression) + Bytes(std::uint64_t{packed.size()}) + packed);
}

std::vector<RecordedDepth> ReadMcap(const std::string& records, int max_frames = 2) {
  return ReadBytes("a.mcap", Mcap(records), ReadBudget(), max_frames);
}

std::string Hex(const std::string& bytes) {
  std::string hex;
  for (const char byte : bytes) hex += fmt::format("{:02x}", static_cast<std::uint8_t>(byte));
  return hex;
}

/// A bag of ROS 2.
std::string WriteDb3(const TempFolder& folder, const std::vector<Topic>& topics,
                     const std::string& before = "") {
  std::string sql =
      before +
      "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
      "serialization_format TEXT NOT NULL);"
      "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "
      "timestamp INTEGER NOT NULL, data BLOB NOT NULL);";
  for (const Topic& topic : topics) {
    sql += fmt::format(
        "INSERT INTO topics(name, type, serialization_format) VALUES('{}', '{}', 'cdr');"
        "INSERT INTO messages(topic_id, timestamp, data) SELECT max(id), 1, x'{}' FROM topics;",
        topic.name, topic.type, Hex(topic.data));
  }
  return WriteDatabase(folder, sql);
}

/// Each form of a recording of both versions of ROS.
struct Form {
  const char* name;
  Ros ros;
  std::function<std::vector<RecordedDepth>(const std::vector<Topic>&)> read;
};
const Form kForms[] = {
    {"bag", Ros::k1, ReadBag},
    {"db3", Ros::k2,
     [](const std::vector<Topic>& topics) {
       const TempFolder folder;
       return ReadRecording(WriteDb3(folder, topics), 2);
     }},
    {"mcap of ROS 1", Ros::k1,
     [](const std::vector<Topic>& topics) { return ReadMcap(McapRecords(topics, "ros1")); }},
    {"mcap of ROS 2", Ros::k2,
     [](const std::vector<Topic>& topics) { return ReadMcap(McapRecords(topics, "cdr")); }},
};

TEST(DescribedRos, EncodingsAndByteOrders) {
  for (const Form& form : kForms) {
    SCOPED_TRACE(form.name);
    for (const Picture& picture :
         {Plain(), Picture{"16UC1", true, Samples(true)}, Picture{"mono16", false, Samples(false)},
          Picture{"mono16", true, Samples(true)}, Picture{"16UC1", false, Padded(Samples(false))}})
      ExpectDepth(form.read({ImageTopic(form.ros, "/camera/depth", picture)}), "/camera/depth",
                  0.001, 1);
    for (const float nothing : {std::nanf(""), HUGE_VALF, -1.0F})
      ExpectDepth(
          form.read({ImageTopic(form.ros, "/camera/depth", {"32FC1", false, Metres(nothing)})}),
          "/camera/depth", 1, 0.001);
  }
}

TEST(DescribedRos, ChunksOfAllKinds) {
  const std::string bag = Records({ImageTopic(Ros::k1, "/camera/depth")});
  const std::string mcap = McapRecords({ImageTopic(Ros::k2, "/camera/depth")}, "cdr");
  for (const std::string& bytes :
       {Bag(Chunk(bag)), Bag(PackedChunk(bag, "bz2", PackBz2(bag))),
        Bag(PackedChunk(bag, "lz4", PackLz4(bag))), Mcap(McapChunk(mcap, "", mcap, Crc(mcap))),
        Mcap(McapChunk(mcap, "zstd", PackZstd(mcap), Crc(mcap))),
        Mcap(McapChunk(mcap, "lz4", PackLz4(mcap), 0))})
    ExpectDepth(ReadBytes("a", bytes), "/camera/depth", 0.001, 1);
}

// Each chunk is within its limit; their number is not. And so is each message.
TEST(DescribedRos, ManyChunksOfZerosAndManyMessages) {
  const std::vector<Topic> zeros = {
      {"/x", "std_msgs/String", std::string(std::size_t{1} << 20, '\0')}};
  const std::string bag = Records(zeros), mcap = McapRecords(zeros, "ros1");
  const std::string of_bag = PackedChunk(bag, "bz2", PackBz2(bag)),
                    of_mcap = McapChunk(mcap, "zstd", PackZstd(mcap), 0);
  std::string bags, mcaps;
  for (int i = 0; i < 60; ++i) bags += of_bag, mcaps += of_mcap;
  std::string messages =
      Connection(0, "/device_0/sensor_0/Depth_0/tf/0", "geometry_msgs/Transform");
  const std::string transform = Message(0, Many<double>({0, 0, 0, 0, 0, 0, 1}));
  for (int i = 0; i < 20000; ++i) messages += transform;
  const std::string packed = PackedChunk(messages, "bz2", PackBz2(messages));
  for (const auto& [bytes, budget] :
       {std::pair(Bag(bags), 24), std::pair(Mcap(mcaps), 24), std::pair(Bag(packed), 22)}) {
    ExpectError<DataError>(
        [&, &of = bytes, bits = budget] {
          ReadBytes("a.bin", of, ReadBudget(std::uint64_t{1} << bits));
        },
        {"a.bin", "unpacked"});
  }
}

// camera_link carries both cameras: the colour one 10 cm along its x and turned by a quarter
// about its z.
TEST(DescribedRos, CameraAndColourCameraByStaticTransforms) {
  const double half = std::sqrt(0.5);
  // Orbbec's ROS wrapper calls its rational lens plumb_bob: with eight coefficients it is OpenCV's.
  const std::vector<double> lenses[] = {{0.1, 0.2, 0.01, 0.02, 0.3},
                                        {16.17, 8.45, 6e-5, -1.5e-5, 0.324, 16.48, 13.94, 1.996}};
  for (const Form& form : kForms) {
    SCOPED_TRACE(form.name);
    for (const std::vector<double>& lens : lenses) {
      const auto streams = form.read(
          {LinksTopic(form.ros, {{"map", "camera_link", {1, 2, 3, 0, 0, 0, 1}},
                                 {"camera_link", "depth_frame", {0, 0, 0.5, 0, 0, 0, 1}}}),
           LinksTopic(form.ros, {{"camera_link", "color_frame", {0.1, 0, 0, 0, 0, half, half}}}),
           CameraTopic(form.ros, "/camera/color/camera_info", "color_frame", 3),
           CameraTopic(form.ros, "/camera/depth/camera_info", "depth_frame", 2, lens),
           ImageTopic(form.ros, "/camera/depth/image_raw")});
      ExpectDepth(streams, "/camera/depth/image_raw", 0.001, 1);
      ASSERT_TRUE(streams[0].intrinsics && streams[0].colour && streams[0].colour->intrinsics);
      EXPECT_EQ(*streams[0].intrinsics, (Intrinsics{kWidth, kHeight, 2, 2, 1, 0.5, lens}));
      EXPECT_EQ(streams[0].colour->intrinsics->fx, 3);
      // (1, 2, 3) of the depth frame is (1, 2, 3.5) of the link; less 0.1 along x, turned back.
      ExpectSeenByColour(streams, {2, -0.9, 3.5});
    }
  }
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
Topic OrbbecImage(const std::string& name, const std::string& encoding, bool older_sdk = false) {
  Topic topic = ImageTopic(Ros::k1, name, {encoding, false, Samples(false)});
  topic.data += Many<float>({0}) + Many<std::uint64_t>({7, 1, 2, 3}) + Block("meta") +
                Many<std::uint32_t>({4}) + (older_sdk ? "" : "\x10");
  return topic;
}

/// custom_msg/property.
template <class T>
std::string OrbbecProperty(std::uint32_t number, T value) {
  return MessageHeader() + Bytes(number) + Block(Bytes(value)) + Bytes(std::uint32_t{sizeof(T)});
}

Topic OrbbecDevice(const std::string& device) {
  return {"/cam/deviceInfo", "custom_msg/DeviceInfo", MessageHeader() + Block(device) + Block("x")};
}

constexpr char kOrbbecDepth[] = "/cam/sensor_3/frameType_3";

std::vector<Topic> OrbbecTopics(const std::string& encoding, const OrbbecProfileFields& profile,
                                const std::string& device = "Femto Bolt",
                                const std::vector<std::string>& properties = {}) {
  OrbbecProfileFields colour;
  colour.type = 2;
  colour.model = 3;
  const std::string kind = "custom_msg/StreamProfileInfo";
  std::vector<Topic> topics;
  for (const std::string& property : properties)
    topics.push_back({"/cam/property", "custom_msg/property", property});
  const std::vector<Topic> others = {
      OrbbecImage("/cam/sensor_1/frameType_1", "mono16"),  // infrared
      OrbbecImage(kOrbbecDepth, encoding),
      OrbbecDevice("Orbbec " + device),
      {"/cam/streamProfileType_3", kind, OrbbecProfile(profile)},
      {"/cam/streamProfileType_2", kind, OrbbecProfile(colour)}};
  topics.insert(topics.end(), others.begin(), others.end());
  return topics;
}

TEST(OrbbecBag, DepthWithItsLensAndColourCamera) {
  const auto mcap = McapRecords(OrbbecTopics("mono16", {}), "ros1");
  for (const auto& streams :
       {ReadBag(OrbbecTopics("mono16", {})), ReadBag(OrbbecTopics("z16", {})), ReadMcap(mcap)}) {
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
  ExpectRefused("a.bag", BagOf(OrbbecTopics("RVL", {})), {"RVL", "frameType_3"});
  OrbbecProfileFields fisheye;
  fisheye.model = 5;
  const auto other_lens = ReadBag(OrbbecTopics("z16", fisheye));
  EXPECT_FALSE(other_lens[0].intrinsics);
  EXPECT_TRUE(Has(other_lens[0].intrinsics_problem, "lens model 5"));
  OrbbecProfileFields rectified;
  rectified.lens.assign(8, 0);
  rectified.model = 1;
  rectified.rotation.assign(9, 0);
  const auto plain = ReadBag(OrbbecTopics("z16", rectified, "Gemini 2"));
  EXPECT_EQ(plain[0].intrinsics->distortion, std::vector<double>(5, 0.0));
  EXPECT_FALSE(plain[0].colour);
  EXPECT_FALSE(plain[0].depth_scale) << "no property states the unit of this Gemini";
}

// Numbers of properties and levels: include/libobsensor/h/Property.h and ObTypes.h of OrbbecSDK
// v2; src/media/record/RecordDevice.cpp records them before the first frame.
TEST(OrbbecBag, UnitAmongTheProperties) {
  const auto read = [](const std::string& device, const std::vector<std::string>& properties) {
    return ReadBag(OrbbecTopics("mono16", {}, device, properties));
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
  ExpectRefused("a.bag",
                BagOf(OrbbecTopics("mono16", {}, "Gemini 335", {OrbbecProperty(85, '\0')})),
                {"frameType_3", "disparities"});
}

TEST(OrbbecBag, OlderLayouts) {
  // OrbbecViewer 1 has the second topic (OrbbecSDK issue 195 shows its /cam0/color_raw).
  for (const char* topic : {kOrbbecDepth, "/cam0/depth_raw"})
    ExpectDepth(ReadBag({OrbbecImage(topic, "mono16", /*older_sdk=*/true),
                         OrbbecDevice("Orbbec Femto Bolt")}),
                topic, 0.001, 1);
}

/// What is read of a bag of images of depth, of `frame`, and a camera on another topic.
RecordedDepth ReadWithCamera(const std::string& topic, const std::string& frame,
                             const Topic& camera) {
  return ReadBag({ImageTopic(Ros::k1, topic, Plain(), frame), camera}).at(0);
}

// Depth and colour of one device share the front of their topics, and often the size.
TEST(DescribedBag, ACameraOfAnotherFrameIsNotTaken) {
  struct Case {
    std::string topic, frame, camera_topic, camera_frame;
    bool taken;
  };
  const std::string raw = "/camera/depth/image_rect_raw", colour = "/camera/color/camera_info";
  for (const Case& c :
       {Case{raw, "depth_optical_frame", colour, "color_optical_frame", false},
        Case{raw, "", colour, "", false},
        Case{raw, "camera_link", colour, "camera_link", false},  // the one it knows
        Case{raw, "depth", "/camera/infra1/camera_info", "infra1", false},
        // Depth that is registered to the colour camera has its lens.
        Case{"/camera/aligned_depth_to_color/image_raw", "color_optical_frame", colour,
             "color_optical_frame", true},
        Case{"/camera/depth_registered/image_raw", "camera_link", colour, "camera_link", true},
        Case{"/kinect2/sd/image_depth", "ir_optical_frame", "/kinect2/sd/camera_info",
             "ir_optical_frame", true}}) {
    SCOPED_TRACE(c.topic + " " + c.camera_topic + " " + c.frame);
    const RecordedDepth depth =
        ReadWithCamera(c.topic, c.frame, CameraTopic(Ros::k1, c.camera_topic, c.camera_frame, 2));
    ASSERT_EQ(depth.intrinsics.has_value(), c.taken);
    if (c.taken) {
      EXPECT_EQ(depth.intrinsics->fx, 2);
      EXPECT_EQ(depth.intrinsics_source, c.camera_topic);
    } else {
      EXPECT_TRUE(Has(depth.intrinsics_problem, c.camera_topic));
    }
  }
}

// K[0] = 0 says that the camera is not calibrated (sensor_msgs/CameraInfo); P may say it all.
TEST(DescribedBag, ALensThatCannotBeUsedIsNoError) {
  const auto read = [](std::size_t zeros_at, std::size_t zeros) {
    Topic camera = CameraTopic(Ros::k1, "/camera/depth/camera_info", "d", 2, {0.1, 0, 0, 0, 0});
    camera.data.replace(camera.data.size() - zeros_at, zeros, zeros, '\0');
    return ReadWithCamera("/camera/depth/image_raw", "d", camera);
  };
  constexpr std::size_t kP = 12 * 8, kAll = kP + 2 * 9 * 8;
  EXPECT_TRUE(read(0, 0).intrinsics_stated);
  const RecordedDepth of_p = read(kAll, 9 * 8);
  ASSERT_TRUE(of_p.intrinsics);
  EXPECT_EQ(of_p.intrinsics->fx, 2);
  EXPECT_EQ(of_p.intrinsics->distortion, std::vector<double>(5, 0.0));
  EXPECT_FALSE(of_p.intrinsics_stated);
  const RecordedDepth none = read(kAll, kAll);
  EXPECT_FALSE(none.intrinsics);
  EXPECT_TRUE(Has(none.intrinsics_problem, "not calibrated"));
  EXPECT_EQ(none.frames.size(), 1u);
}

// What the capture says is not asked of the recording; a convention is no statement.
TEST(DescribedBag, ACaptureOverridesIt) {
  const TempFolder folder;
  folder.Write("a.bag", Bag(Chunk(Records({ImageTopic(Ros::k1, "/d/image", Plain(), "d"),
                                           CameraTopic(Ros::k1, "/d/camera_info", "d", 0)}))));
  const auto read = [&](const std::string& more) {
    const std::string sensor = R"({"name": "A", "depth": "a.bag")" + more + "}";
    return ReadCapture(
        folder.Write("capture.json", R"({"depth_scale": 0.0001, "sensors": [)" + sensor + "]}"));
  };
  const std::string intrinsics =
      R"(, "intrinsics": {"width": 3, "height": 2, "fx": 5, "fy": 5.5, "cx": 1, "cy": 1})";
  const SensorFrame frame = read(intrinsics).sensors[0];
  EXPECT_EQ(frame.intrinsics.fy, 5.5);
  EXPECT_FLOAT_EQ(frame.depth(1, 0), 0.1001F);
  ExpectError<DataError>([&] { read(""); },
                         {"sensor \"A\"", "/d/camera_info", "not calibrated", "intrinsics"});
}

TEST(DescribedBag, ARectifiedImageHasTheCameraWithoutTheLens) {
  const std::vector<double> lens = {0.1, 0, 0, 0, 0};
  const Topic camera = CameraTopic(Ros::k1, "/camera/depth/camera_info", "d", 2, lens);
  for (const std::string name : {"image_rect", "image_raw"}) {
    const RecordedDepth depth = ReadWithCamera("/camera/depth/" + name, "d", camera);
    EXPECT_EQ(depth.intrinsics.value().distortion,
              name == "image_rect" ? std::vector<double>(5, 0.0) : lens);
  }
}

// No unit of a recording: the capture has to state one. The other stream has ROS's own.
TEST(DescribedBag, UnitOfRealSense) {
  const std::string sensor = "/device_0/sensor_0";
  for (const float unit : {0.0001F, 0.0F, -1.0F, std::nanf(""), HUGE_VALF}) {
    const auto streams =
        ReadBag({ImageTopic(Ros::k1, sensor + "/Depth_0/image/data"),
                 ImageTopic(Ros::k1, "/other/depth"),
                 {sensor + "/option/Depth Units/value", "std_msgs/Float32", Bytes(unit)}});
    ASSERT_EQ(streams.size(), 2u);
    EXPECT_EQ(streams[0].depth_scale.has_value(), unit == 0.0001F) << unit;
    EXPECT_EQ(streams[0].depth_scale.value_or(0.0001), 0.0001) << "not as a float has it";
    EXPECT_EQ(streams[1].depth_scale, 0.001);
    EXPECT_NE(streams[1].depth_scale_source, streams[0].depth_scale_source);
  }
}

// librealsense's recorder says where the reference stream is in each stream's frame.
TEST(DescribedBag, ColourCameraOfRealSense) {
  const double half = std::sqrt(0.5);
  const std::string depth = "/device_0/sensor_0/Depth_0", colour = "/device_0/sensor_1/Color_0";
  const std::string transform = "geometry_msgs/Transform";
  const auto streams =
      ReadBag({ImageTopic(Ros::k1, depth + "/image/data", {"mono16", false, Samples(false)}),
               CameraTopic(Ros::k1, depth + "/info/camera_info", "", 2),
               CameraTopic(Ros::k1, colour + "/info/camera_info", "", 3),
               {depth + "/tf/0", transform, Many<double>({0, 0, 0, 0, 0, 0, 1})},
               {colour + "/tf/0", transform, Many<double>({0.015, 0, 0, half, 0, 0, half})}});
  ExpectSeenByColour(streams, {1.015, -3, 2});
  EXPECT_EQ(streams[0].intrinsics.value().fx, 2);
}

TEST(DescribedBag, SaysWhatIsDamagedOrMissing) {
  const Picture colour = {"rgb8", false, std::string(std::size_t{3} * kWidth * kHeight, 'x')};
  Topic rows = ImageTopic(Ros::k1, "/depth");
  rows.data[MessageHeader("camera").size()] = 3;
  const Topic narrow = ImageTopic(Ros::k1, "/depth", {"16UC1", false, Samples(false).substr(2)});
  std::string connections;
  for (std::uint32_t i = 0; i < 1001; ++i) connections += Connection(i, "/a", "b/C");
  for (const auto& [bytes, part] :
       {std::pair(BagOf({ImageTopic(Ros::k1, "/camera/color", colour)}),
                  "/camera/color (sensor_msgs/Image)"),
        std::pair(BagOf({rows}), "3x3"), std::pair(BagOf({narrow}), "3x2"),
        std::pair(Bag(Chunk(Message(5, "one"))), "unknown connection"),
        std::pair(Bag(Chunk("x", "zip")), "\"zip\""),
        std::pair(Bag(Chunk("no stream of bz2", "bz2")), "bz2"),
        std::pair(Bag(Chunk("no frame of lz4", "lz4")), "lz4"),
        std::pair(Bag(Chunk(Bytes<std::uint32_t>(1000))), "1000 bytes are announced"),
        std::pair(Bag(connections), "1000 topics"), std::pair(std::string("#ROSBAG V1.2\n"), "2.0"),
        std::pair("#ROSBAG V2.0\n" + Chunk(""), "")})
    ExpectRefused("c.bag", bytes, {part});
}

std::string CdrText(const std::string& text) {
  return MessageWriter(Ros::k2).AddText(text).bytes();
}

/// As librealsense 2.58 writes it, whose lens is a text.
std::vector<Topic> RealSense258() {
  const std::string stream = "/device_0/sensor_0/Depth_0", text = "std_msgs/msg/String";
  return {{stream + "/camera_info", text,
           CdrText("width=3;height=2;fx=2.5;ppx=1.25;fy=2.25;ppy=0.5;model=Brown Conrady;"
                   "coeffs=0,0,0,0,0")},
          {"/device_0/info", text, CdrText("Name=Intel RealSense D415;Serial Number=7")},
          {"/device_0/sensor_0/option/Depth_Units/value", text, CdrText("0.000100")},
          ImageTopic(Ros::k2, stream + "/image/data", {"mono16", false, Samples(false)}),
          {stream + "/tf/ref_1", text,
           CdrText("rotation=1,0,0,0,1,0,0,0,1;translation=0.000000,0.000000,0.000000")}};
}

TEST(DescribedDb3, MessagesAndFilesThatZstdPacked) {
  const TempFolder folder;
  std::vector<Topic> packed = RealSense258();
  for (Topic& message : packed) message.data = PackZstd(message.data);
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
  MessageWriter compressed(Ros::k2);
  compressed.AddHeader("camera").AddText("16UC1; compressedDepth rvl").AddBytes("not read");
  const Topic images = ImageTopic(Ros::k2, "/camera/depth/image");
  const Topic others = {"/camera/depth/image/compressedDepth", "sensor_msgs/msg/CompressedImage",
                        compressed.bytes()};
  for (const auto& both : {std::vector{images, others}, std::vector{others, images}})
    ExpectDepth(ReadRecording(WriteDb3(folder, both), 10), images.name, 0.001, 1);
  ExpectError<DataError>([&] { ReadRecording(WriteDb3(folder, {others}), 10); },
                         {"a.db3", "/camera/depth/image", "rvl", "PNG", "image_transport"});
  // Beside a camera that can be read, it is said of the stream.
  const auto streams =
      ReadRecording(WriteDb3(folder, {others, ImageTopic(Ros::k2, "/other/depth/image")}), 10);
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

constexpr char kTopics[] =
    "CREATE TABLE topics(id INTEGER, name TEXT, type TEXT, serialization_format TEXT);"
    "INSERT INTO topics VALUES(1, '/depth', 'sensor_msgs/msg/Image', 'cdr');";
constexpr char kMessages[] =
    "CREATE TABLE messages(id INTEGER, topic_id INTEGER, timestamp INTEGER, data BLOB);";

/// The statement, a thousand times.
std::string Often(const std::string& statement) {
  std::string sql = "BEGIN;";
  for (int i = 0; i < 1000; ++i) sql += statement;
  return sql + "COMMIT;";
}

// What a bag says is data, never a part of a statement. A view runs what it likes, for ever, and a
// table's column may be made up.
TEST(DescribedDb3, RefusesStatementsViewsAndWhatIsTooMuch) {
  const TempFolder folder;
  const std::string topics = kTopics, messages = kMessages;
  const auto expect = [&](const std::string& sql, std::initializer_list<std::string> parts) {
    ExpectRefused("a.db3", ReadFile(WriteDatabase(folder, sql)), parts);
  };
  expect(messages +
             "CREATE TABLE topics(id TEXT, name TEXT, type TEXT, serialization_format TEXT);"
             "INSERT INTO topics VALUES('0 UNION SELECT ''INJECTED'' --', '/depth', "
             "'sensor_msgs/msg/Image', 'cdr');",
         {"topic", "id"});
  expect(topics +
             "CREATE VIEW messages(id, topic_id, timestamp, data) AS WITH RECURSIVE n(i) AS "
             "(SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i, 2, i, 'x' FROM n;",
         {"table messages"});
  expect(messages +
             "CREATE VIEW topics AS SELECT 1 AS id, '/depth' AS name, "
             "'' AS type, 'cdr' AS serialization_format;",
         {"table topics"});
  expect(topics +
             "CREATE TABLE messages(id INTEGER, topic_id INTEGER, "
             "timestamp INTEGER, data AS (zeroblob(900000000)));"
             "INSERT INTO messages VALUES(1, 1, 1);",
         {"column data", "computed"});
  expect(topics + messages + Often("INSERT INTO topics VALUES(1, '/a', 'b', 'cdr');"),
         {"1000 topics"});
  expect(topics + messages + "UPDATE topics SET name = '/" + std::string(2000, 'a') + "';",
         {"a text of 2001 bytes"});
  const Topic depth = RealSense258()[3];
  std::string turn = "rotation=";
  for (int i = 0; i < 100000; ++i) turn += "1,";
  const Topic long_text = {"/device_0/sensor_0/Depth_0/tf/ref_1", "std_msgs/msg/String",
                           CdrText(turn)};
  ExpectRefused("a.db3", ReadFile(WriteDb3(folder, {depth, long_text})), {"a text of"});
}

TEST(DescribedDb3, TakesNoMoreStepsThanItsBudget) {
  const TempFolder folder;
  const std::string many =
      WriteDatabase(folder, std::string(kTopics) + kMessages +
                                Often("INSERT INTO messages VALUES(1, 2, 3, 'x');"));
  const auto read = [&](std::uint64_t steps) {
    ReadBudget budget(steps);
    return ReadRos2Recording(many, "a.db3", 3, &budget);
  };
  EXPECT_TRUE(read(1000000).streams.empty());
  ExpectError<DataError>([&] { read(2000); }, {"a.db3", "interrupted"});
}

TEST(DescribedMcap, ManyStreamsOfLongNames) {
  std::vector<Topic> topics;
  for (int i = 1; i < 500; ++i)
    topics.push_back(ImageTopic(Ros::k1, fmt::format("/{:0>200}\x1b/depth/image", i)));
  const TempFolder folder;
  folder.Write("a.mcap", Mcap(McapRecords(topics, "ros1")));
  const std::string capture =
      folder.Write("capture.json", R"({"sensors": [{"name": "A", "depth": "a.mcap"}]})");
  const std::string said =
      ExpectError<DataError>([&] { ReadCapture(capture); }, {"several depth streams"});
  EXPECT_LT(said.size(), 600u) << said;
  EXPECT_FALSE(Has(said, "\x1b"));
}

TEST(DescribedMcap, IsReadUpToTheLastFrameAndItsCamera) {
  const Topic image = ImageTopic(Ros::k2, "/camera/depth/image_raw"),
              camera = CameraTopic(Ros::k2, "/camera/depth/camera_info", "camera", 2);
  const auto chunk = [](const std::string& records, const std::string& compression = "") {
    return McapChunk(records, compression, records, 0);
  };
  for (const auto& topics : {std::vector{image, camera}, std::vector{camera, image}}) {
    const std::string first = McapRecords({topics[0]}, "cdr"), both = McapRecords(topics, "cdr");
    const auto streams =
        ReadMcap(chunk(first) + chunk(both.substr(first.size())) + chunk("unknown", "brotli"), 1);
    EXPECT_TRUE(streams.at(0).intrinsics);
  }
}

// The index after a chunk (opcode 7) names the channels in it. Chunks without new ones stay unread.
TEST(DescribedMcap, AStreamMayBeginAfterTheOthersHaveTheirFrames) {
  const std::vector<Topic> topics{CameraTopic(Ros::k2, "/a/depth/camera_info", "a", 2),
                                  ImageTopic(Ros::k2, "/a/depth/image_raw", Plain(), "a"),
                                  CameraTopic(Ros::k2, "/b/depth/camera_info", "b", 2),
                                  ImageTopic(Ros::k2, "/b/depth/image_raw", Plain(), "b")};
  const std::string all = McapRecords(topics, "cdr"),
                    first = McapRecords({topics[0], topics[1]}, "cdr"),
                    rest = all.substr(first.size());
  const auto index = [](std::uint16_t channel) {
    return McapRecord(7, Bytes(channel) + Block(""));
  };
  const std::string unread = McapChunk(first, "brotli", first, 0) + index(1) + index(2);
  const auto streams = ReadMcap(McapChunk(first, "", first, 0) + index(1) + index(2) + unread +
                                    McapChunk(rest, "", rest, 0) + index(3) + index(4) + unread,
                                1);
  ASSERT_EQ(streams.size(), 2u);
  EXPECT_TRUE(streams[0].intrinsics && streams[1].intrinsics);
}

TEST(DescribedMcap, DamagedOrUnknown) {
  const std::string records = McapRecords({ImageTopic(Ros::k2, "/camera/depth")}, "cdr");
  const auto expect = [&](const std::string& of, std::initializer_list<std::string> parts) {
    ExpectRefused("a.mcap", Mcap(of), parts);
  };
  expect(McapChunk(records, "", records, Crc(records) + 1), {"CRC-32"});
  expect(McapChunk(records, "brotli", records, 0), {"brotli", "zstd and lz4"});
  expect(McapChunk(records, "zstd", records, 0), {"damaged"});
  expect(McapRecords({{"/camera/depth", "my.Image", "x"}}, "protobuf"),
         {"/camera/depth (my.Image, encoded as protobuf)"});
  // Cut off within its last chunk, what stands before is read.
  const std::string file = records + McapChunk(records, "", records, 0);
  ExpectDepth(ReadMcap(file.substr(0, file.size() - 9)), "/camera/depth", 0.001, 1);
}

// A copy that was interrupted, as some programs make it: as long as the whole, and empty behind.
TEST(DescribedMcap, EndsAtAHoleAsWhatZstdPackedDoes) {
  const TempFolder folder;
  const std::string path =
      folder.Write("a.mcap", Mcap(McapRecords({ImageTopic(Ros::k2, "/camera/depth")}, "cdr")));
  std::filesystem::resize_file(path, std::uintmax_t{1} << 40);
  ExpectDepth(ReadRecording(path, 100), "/camera/depth", 0.001, 1);
  const std::string packed = folder.Write("a.bag", "\x28\xb5\x2f\xfd");
  std::filesystem::resize_file(packed, std::uintmax_t{1} << 40);
  ExpectError<DataError>([&] { ReadRecording(packed, 1); }, {"a.bag", "damaged"});
}

// Matroska (RFC 9559).

/// What an element begins with, its size in eight bytes.
std::string ElementHead(const std::string& id, std::uint64_t size) {
  std::string bytes = id + '\x01';
  for (int byte = 6; byte >= 0; --byte) bytes += static_cast<char>(size >> (8 * byte));
  return bytes;
}
std::string Element(const std::string& id, const std::string& data) {
  return ElementHead(id, data.size()) + data;
}

constexpr char kTracks[] = "\x16\x54\xAE\x6B", kCluster[] = "\x1F\x43\xB6\x75";

/// BITMAPINFOHEADER up to biCompression, and zeros.
std::string BitmapHeader(const std::string& compression) {
  return Bytes<std::uint32_t>(40) + Bytes<std::int32_t>(kWidth) + Bytes<std::int32_t>(kHeight) +
         Bytes<std::uint16_t>(1) + Bytes<std::uint16_t>(16) + compression + std::string(20, '\0');
}

/// A track whose codec and own elements are given.
std::string Track(const std::string& codec, const std::string& of_track,
                  const std::string& of_video) {
  const std::string number = "\x01", width(1, kWidth), height(1, kHeight);
  return Element("\xAE",
                 Element("\xD7", number) + Element("\x73\xC5", number) + Element("\x83", number) +
                     Element("\x86", codec) + of_track +
                     Element("\xE0", Element("\xB0", width) + Element("\xBA", height) + of_video));
}
std::string GreyTrack() { return Track("V_UNCOMPRESSED", "", Element("\x2E\xB5\x24", "b16g")); }

/// One frame of that track, in a BlockGroup or a SimpleBlock.
std::string Frame(bool big_endian = true, bool group = true) {
  const std::string block = std::string("\x81\x00\x00\x00", 4) + Samples(big_endian);
  return Element("\xE7", std::string(1, '\0')) +
         (group ? Element("\xA0", Element("\xA1", block)) : Element("\xA3", block));
}

/// A segment of these tracks and further parts.
std::string Mkv(const std::string& tracks, const std::string& parts) {
  return Element("\x1A\x45\xDF\xA3", Element("\x42\x82", "matroska")) +
         Element("\x18\x53\x80\x67", Element(kTracks, tracks) + parts);
}

TEST(DescribedMkv, GreyOf16BitsInBothByteOrdersAndBlocks) {
  for (const bool group : {true, false}) {
    for (const auto& [fourcc, big_endian] : {std::pair("Y16 ", false), std::pair("b16g", true)}) {
      for (const bool vfw : {true, false}) {
        SCOPED_TRACE(fourcc);
        const std::string track =
            vfw ? Track("V_MS/VFW/FOURCC", Element("\x63\xA2", BitmapHeader(fourcc)), "")
                : Track("V_UNCOMPRESSED", "", Element("\x2E\xB5\x24", fourcc));
        const std::vector<RecordedDepth> streams =
            ReadBytes("a.mkv", Mkv(track, Element(kCluster, Frame(big_endian, group))));
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

// As a recorder that writes live leaves it: clusters without a size.
TEST(DescribedMkv, ClustersWithoutSize) {
  const std::string cluster = ElementHead(kCluster, (std::uint64_t{1} << 56) - 1) + Frame();
  const TempFolder folder;
  const auto file = folder.Write("a.mkv", Mkv(GreyTrack(), cluster + cluster + cluster));
  ASSERT_EQ(ReadRecording(file, 5).size(), 1u);
  EXPECT_EQ(ReadRecording(file, 5)[0].frames.size(), 3u);
  EXPECT_EQ(ReadRecording(file, 2)[0].frames.size(), 2u);
}

// Tracks of one number would each keep a copy of every frame.
TEST(DescribedMkv, ATrackTwice) {
  const std::string tracks = GreyTrack() + GreyTrack() + GreyTrack();
  EXPECT_EQ(ReadBytes("a.mkv", Mkv(tracks, Element(kCluster, Frame()))).size(), 1u);
}

}  // namespace
}  // namespace volalign::described_recordings_test
