// Depth streams of a bag: what the recorders of RealSense and Orbbec write, and depth images of
// ROS 1.

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <string>
#include <string_view>

#include "core/base/error.h"
#include "core/base/text.h"
#include "infer/formats/byte_reader.h"
#include "infer/formats/recording.h"
#include "infer/formats/ros_bag.h"
#include "infer/formats/ros_depth.h"

namespace volalign::formats_internal {

namespace {

class BagReader : public ByteReader {
 public:
  using ByteReader::ByteReader;
  std::string_view Bytes() { return Block(); }
  std::string Text() { return std::string(Block()); }
  /// std_msgs/Header.
  std::string Header() {
    Take(3 * sizeof(std::uint32_t));  // seq, stamp
    return Text();                    // frame_id
  }
};

OrbbecProfile ReadOrbbecProfile(std::string_view message, const std::string& name) {
  enum Model : std::uint8_t { kNone = 0, kBrownConrady = 3, kRational = 4 };
  BagReader reader(message, name);
  reader.Header();
  reader.Take(2);  // type of the stream, format
  const auto take = [&](auto* values) {
    for (float& value : *values) value = reader.Value<float>();
  };
  std::array<float, 9> r;  // row by row
  std::array<float, 3> t;  // mm
  take(&r);
  take(&t);
  OrbbecProfile profile;
  profile.intrinsics.width = reader.Value<std::uint16_t>();
  profile.intrinsics.height = reader.Value<std::uint16_t>();
  reader.Value<std::uint16_t>();  // frames a second
  std::array<float, 4> f;         // fx fy cx cy
  std::array<float, 8> d;         // k1 ... k6 p1 p2
  take(&f);
  take(&d);
  const auto model = reader.Value<std::uint8_t>();
  profile.intrinsics.fx = f[0];
  profile.intrinsics.fy = f[1];
  profile.intrinsics.cx = f[2];
  profile.intrinsics.cy = f[3];
  const bool is_zero = std::all_of(d.begin(), d.end(), [](float x) { return x == 0; });
  if (model == kNone || is_zero) {
    profile.intrinsics.distortion.assign(5, 0.0);
  } else if (model == kBrownConrady || model == kRational) {
    profile.intrinsics.distortion = {d[0], d[1], d[6], d[7], d[2], d[3], d[4], d[5]};
  } else {
    profile.lens = fmt::format(
        "the lens model {} of the Orbbec SDK (modified or inverse Brown-Conrady, Kannala-Brandt) "
        "is not OpenCV's; record with the SDK's rectification, or give \"intrinsics\"",
        model);
  }
  // The recorder leaves zeros where the streams had no extrinsics.
  if (std::any_of(r.begin(), r.end(), [](float x) { return x != 0; })) {
    profile.colour_from_stream = PoseFromRotation(
        Eigen::Map<const Eigen::Matrix<float, 3, 3, Eigen::RowMajor>>(r.data()).cast<double>(),
        1e-3 * Eigen::Map<const Eigen::Vector3f>(t.data()).cast<double>(),
        name + ": a stream profile");
  }
  return profile;
}

/// custom_msg/property: a header, the property's number (include/libobsensor/h/Property.h of
/// OrbbecSDK v2) and its bytes.
void ReadOrbbecProperty(std::string_view message, const std::string& name,
                        OrbbecProperties* properties) {
  enum Number : std::uint32_t {
    kDepthPrecisionLevel = 75,  // int, a place in kUnits
    kDisparityToDepth = 85,     // bool: the device itself makes depth of its disparities
    kFlexibleDepthUnit = 176,   // float, mm: Gemini 330
  };
  // mm, in the order of OBDepthPrecisionLevel.
  constexpr std::array<double, 7> kUnits = {1, 0.8, 0.4, 0.1, 0.2, 0.5, 0.05};
  BagReader reader(message, name);
  reader.Header();
  const auto number = reader.Value<std::uint32_t>();
  BagReader data(reader.Bytes(), name);
  if (number == kDisparityToDepth) {
    properties->frames_are_disparity = data.Value<std::uint8_t>() == 0;
  } else if (number == kFlexibleDepthUnit) {
    properties->unit = 1e-3 * data.Value<float>();
  } else if (number == kDepthPrecisionLevel) {
    const auto level = data.Value<std::uint32_t>();
    if (level < kUnits.size()) properties->unit = 1e-3 * kUnits[level];
  }
}

/// Whether nothing more is to come: every image topic that may be depth has all its frames.
bool IsComplete(const RosContent& content, const RosBag& bag, int max_frames) {
  if (!bag.has_index() || content.streams.empty()) return false;
  for (const auto& [id, connection] : bag.connections()) {
    if (connection.type == "sensor_msgs/CameraInfo" && !content.infos.count(connection.topic))
      return false;
    if (const std::string number = OrbbecProfileNumber(connection.topic);
        !number.empty() && !content.profiles.count(number))
      return false;
    if (connection.topic == kOrbbecDevice && !content.devices.count(kOrbbecDevice)) return false;
    if (IsStaticTransform(connection.topic) && content.transforms.empty()) return false;
    if (connection.type == "geometry_msgs/Transform" && IsStreamTransform(connection.topic) &&
        std::none_of(content.transforms.begin(), content.transforms.end(),
                     [&connection = connection](const RosTransform& transform) {
                       return connection.topic.rfind(transform.child + "/", 0) == 0;
                     }))
      return false;
    if (connection.type != "sensor_msgs/Image" ||
        (Lower(connection.topic).find("depth") == std::string::npos &&
         OrbbecStream(connection.topic) != kOrbbecDepth))
      continue;
    const auto found = content.streams.find(connection.topic);
    if (found == content.streams.end() ||
        static_cast<int>(found->second.frames.size()) < max_frames)
      return false;
  }
  return true;
}

}  // namespace

bool CollectRos1(const std::string& topic, const std::string& type, std::string_view message,
                 int max_frames, const std::string& name, RosContent* content) {
  content->contents.insert(fmt::format("{} ({})", topic, type));
  if (type == "sensor_msgs/Image") {
    const RosImage image = ReadImage(BagReader(message, name));
    if (OrbbecStream(topic) == kOrbbecDepth && !IsDepth(topic, image.encoding)) {
      throw DataError(fmt::format(
          "{}: {}: depth encoded as \"{}\"; mono16 and z16 are read: record without compression of "
          "the depth",
          name, topic, Shortened(image.encoding)));
    }
    if (!IsDepth(topic, image.encoding)) return false;
    RecordedDepth& stream = content->streams[topic];
    stream.stream = topic;
    if (image.encoding == "32FC1") stream.depth_scale = 1;
    if (static_cast<int>(stream.frames.size()) >= max_frames) return false;
    stream.frames.push_back(DecodeImage(image, name));
    return true;
  }
  if (type == "sensor_msgs/CameraInfo") {
    return content->infos.emplace(topic, ReadCameraInfo(BagReader(message, name), name)).second;
  }
  if (const std::string number = OrbbecProfileNumber(topic); !number.empty()) {
    return content->profiles.emplace(number, ReadOrbbecProfile(message, name)).second;
  }
  if (topic == kOrbbecDevice) {
    BagReader reader(message, name);
    reader.Header();
    return content->devices[topic].emplace("name", reader.Text()).second;
  }
  if (topic == kOrbbecProperty) {
    ReadOrbbecProperty(message, name, &content->properties);
    return false;
  }
  if (type == "std_msgs/Float32") {
    if (IsDepthUnits(topic)) content->units[topic] = BagReader(message, name).Value<float>();
  } else if (IsStaticTransform(topic)) {
    for (RosTransform& transform : ReadTransforms(BagReader(message, name), name))
      content->transforms.push_back(std::move(transform));
    return true;
  } else if (type == "geometry_msgs/Transform" && IsStreamTransform(topic)) {
    BagReader reader(message, name);
    content->transforms.push_back(StreamTransform(topic, ReadTransform(&reader, name)));
    return true;
  } else if (type == "diagnostic_msgs/KeyValue" && IsDeviceInfo(topic)) {
    BagReader reader(message, name);
    const std::string key = reader.Text();
    content->devices[topic].emplace(key, reader.Text());
  }
  return false;
}

Recording ReadBagRecording(const std::filesystem::path& path, int max_frames) {
  const std::string name = path.string();
  RosBag bag(path);
  RosContent content;
  bag.ForEachMessage([&](const BagConnection& connection, std::string_view message) {
    // Asked after what may complete it alone: it goes through all connections.
    return !CollectRos1(connection.topic, connection.type, message, max_frames, name, &content) ||
           !IsComplete(content, bag, max_frames);
  });
  return DescribeStreams(std::move(content), name);
}

}  // namespace volalign::formats_internal
