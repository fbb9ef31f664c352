// Depth streams of a bag: of the recorders of RealSense and Orbbec, and depth images of ROS 1.

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
  BagReader(std::string_view bytes, const std::string& name)
      : ByteReader(bytes, name), name_(name) {}
  std::string_view Bytes() { return Block(); }
  std::string Text() { return BoundedText(Block(), name_); }
  /// std_msgs/Header.
  std::string Header() {
    Take(3 * sizeof(std::uint32_t));  // seq, stamp
    return Text();                    // frame_id
  }

 private:
  const std::string& name_;
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
  reader.Value<std::uint16_t>();  // frames per second
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
  // The recorder leaves zeros if the streams had no extrinsics.
  if (std::any_of(r.begin(), r.end(), [](float x) { return x != 0; })) {
    try {
      profile.colour_from_stream = PoseFromRotation(
          Eigen::Map<const Eigen::Matrix<float, 3, 3, Eigen::RowMajor>>(r.data()).cast<double>(),
          1e-3 * Eigen::Map<const Eigen::Vector3f>(t.data()).cast<double>(),
          name + ": a stream profile");
    } catch (const DataError&) {
      // Depth does not need it.
    }
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

/// Is nothing more to come? Every image topic that may be depth then has all its frames, and a
/// message of each topic that describes them was seen.
bool IsComplete(const RosContent& content, const RosBag& bag, int max_frames) {
  if (!bag.has_index() || content.streams.empty()) return false;
  for (const auto& [id, connection] : bag.connections()) {
    const std::string& topic = connection.topic;
    const bool describes =
        connection.type == "sensor_msgs/CameraInfo" || !OrbbecProfileNumber(topic).empty() ||
        topic == kOrbbecDevice || IsStaticTransform(topic) ||
        (connection.type == "geometry_msgs/Transform" && IsStreamTransform(topic));
    if (describes && content.contents.count(topic) == 0) return false;
    const bool is_depth =
        connection.type == "sensor_msgs/Image" && !IsNamedOtherwise(topic) &&
        (Lower(topic).find("depth") != std::string::npos || OrbbecStream(topic) == kOrbbecDepth);
    if (is_depth && content.streams.count(topic) == 0) return false;
  }
  return HasAllFrames(content, max_frames);
}

}  // namespace

bool CollectRos1(const std::string& topic, const std::string& type, std::string_view message,
                 const RosReading& reading, RosContent* content) {
  const std::string& name = reading.name;
  const bool first = content->contents.emplace(topic, type).second;
  if (type == "sensor_msgs/Image") {
    const RosImage image = ReadImage(BagReader(message, name));
    const bool is_depth = IsDepth(topic, image.encoding);
    if (!is_depth && OrbbecStream(topic) != kOrbbecDepth) return first;
    RosStream& stream = content->streams[topic];
    stream.stream = topic;
    if (!is_depth) {
      stream.problem = fmt::format(
          "depth encoded as \"{}\"; mono16 and z16 are read: record without compression of the "
          "depth",
          Shortened(image.encoding));
      return first;
    }
    if (image.encoding == "32FC1") stream.depth_scale = 1;
    return AddFrame(
        reading, image.frame, [&] { return DecodeImage(image, name); }, &stream);
  }
  if (type == "sensor_msgs/CameraInfo") {
    if (content->infos.count(topic) == 0)
      content->infos.emplace(topic, ReadCameraInfo(BagReader(message, name), name));
  } else if (const std::string number = OrbbecProfileNumber(topic); !number.empty()) {
    content->profiles.emplace(number, ReadOrbbecProfile(message, name));
  } else if (topic == kOrbbecDevice) {
    BagReader reader(message, name);
    reader.Header();
    AddDevicePair("name", reader.Text(), &content->devices[topic]);
  } else if (topic == kOrbbecProperty) {
    ReadOrbbecProperty(message, name, &content->properties);
  } else if (type == "std_msgs/Float32" && IsDepthUnits(topic)) {
    content->units[topic] = BagReader(message, name).Value<float>();
  } else if (IsStaticTransform(topic)) {
    ReadTransforms(BagReader(message, name), name, &content->transforms);
  } else if (type == "geometry_msgs/Transform" && IsStreamTransform(topic)) {
    BagReader reader(message, name);
    AddStreamTransform(topic, ReadTransform(&reader), &content->transforms);
  } else if (type == "diagnostic_msgs/KeyValue" && IsDeviceInfo(topic)) {
    BagReader reader(message, name);
    const std::string key = reader.Text();
    AddDevicePair(key, reader.Text(), &content->devices[topic]);
  }
  return first;
}

Recording ReadBagRecording(const std::filesystem::path& path, const std::string& name,
                           int max_frames, ReadBudget* budget) {
  RosBag bag(path, name, budget);
  RosContent content;
  const RosReading reading{name, max_frames, budget};
  bag.ForEachMessage([&](const BagConnection& connection, std::string_view message) {
    // This comes only after messages that may complete it, because it visits all connections.
    return !CollectRos1(connection.topic, connection.type, message, reading, &content) ||
           !IsComplete(content, bag, max_frames);
  });
  return DescribeStreams(std::move(content), name);
}

}  // namespace volalign::formats_internal
