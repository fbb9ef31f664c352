// Depth streams of a bag: what RealSense's recorder writes, and depth images of ROS 1.

#include <array>
#include <cstdint>

#include "core/error.h"
#include "infer/io/formats/byte_reader.h"
#include "infer/io/formats/recording.h"
#include "infer/io/formats/ros_bag.h"
#include "infer/io/formats/ros_depth.h"

namespace volalign::formats_internal {

namespace {

/// std_msgs/Header.
void SkipHeader(ByteReader* reader) {
  reader->Take(3 * sizeof(std::uint32_t));  // seq, stamp
  reader->Block();                          // frame_id
}

RosImage ParseImage(std::string_view message, const std::string& name) {
  ByteReader reader(message, name);
  SkipHeader(&reader);
  RosImage image;
  image.height = reader.Value<std::uint32_t>();
  image.width = reader.Value<std::uint32_t>();
  image.encoding = std::string(reader.Block());
  image.big_endian = reader.Value<std::uint8_t>() != 0;
  image.step = reader.Value<std::uint32_t>();
  image.data = reader.Block();
  return image;
}

CameraInfo ParseCameraInfo(std::string_view message, const std::string& name) {
  ByteReader reader(message, name);
  SkipHeader(&reader);
  CameraInfo info;
  info.raw.height = static_cast<int>(reader.Value<std::uint32_t>());
  info.raw.width = static_cast<int>(reader.Value<std::uint32_t>());
  info.model = std::string(reader.Block());
  const auto count = reader.Value<std::uint32_t>();
  if (count > 64) throw DataError(name + ": damaged: a lens of more than 64 coefficients");
  for (std::uint32_t i = 0; i < count; ++i) info.raw.distortion.push_back(reader.Value<double>());
  std::array<double, 9> k, r;
  std::array<double, 12> p;
  for (double& x : k) x = reader.Value<double>();
  for (double& x : r) x = reader.Value<double>();
  for (double& x : p) x = reader.Value<double>();
  info.SetMatrices(k, p);
  return info;
}

void Collect(const BagConnection& connection, std::string_view message, int max_frames,
             const std::string& name, RosContent* content) {
  if (connection.type == "sensor_msgs/Image") {
    const RosImage image = ParseImage(message, name);
    if (!IsDepth(connection.topic, image.encoding)) return;
    RecordedDepth& stream = content->streams[connection.topic];
    stream.stream = connection.topic;
    if (static_cast<int>(stream.frames.size()) < max_frames)
      stream.frames.push_back(DecodeImage(image, name));
    if (image.encoding == "32FC1") stream.depth_scale = 1;
  } else if (connection.type == "sensor_msgs/CameraInfo") {
    content->infos.emplace(connection.topic, ParseCameraInfo(message, name));
  } else if (connection.type == "std_msgs/Float32") {
    if (IsDepthUnits(connection.topic))
      content->units[connection.topic] = ByteReader(message, name).Value<float>();
  } else if (connection.type == "diagnostic_msgs/KeyValue" && IsDeviceInfo(connection.topic)) {
    ByteReader reader(message, name);
    const std::string key(reader.Block());
    content->devices[connection.topic].emplace(key, std::string(reader.Block()));
  }
}

/// Whether nothing more is to come: every image topic that may be depth has all its frames.
bool IsComplete(const RosContent& content, const RosBag& bag, int max_frames) {
  if (bag.connections().empty() || content.streams.empty()) return false;
  for (const auto& [id, connection] : bag.connections()) {
    if (connection.type == "sensor_msgs/CameraInfo" && !content.infos.count(connection.topic))
      return false;
    if (connection.type != "sensor_msgs/Image" ||
        Lower(connection.topic).find("depth") == std::string::npos)
      continue;
    const auto found = content.streams.find(connection.topic);
    if (found == content.streams.end() ||
        static_cast<int>(found->second.frames.size()) < max_frames)
      return false;
  }
  return true;
}

}  // namespace

std::vector<RecordedDepth> ReadBagRecording(const std::filesystem::path& path, int max_frames) {
  const std::string name = path.string();
  RosBag bag(path);
  RosContent content;
  bag.ForEachMessage([&](const BagConnection& connection, std::string_view message) {
    Collect(connection, message, max_frames, name, &content);
    return !IsComplete(content, bag, max_frames);
  });
  return DescribeStreams(std::move(content), name);
}

}  // namespace volalign::formats_internal
