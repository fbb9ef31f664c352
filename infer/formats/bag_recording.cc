// Depth streams of a bag: what RealSense's recorder writes, and depth images of ROS 1.

#include <cstdint>
#include <string>
#include <string_view>

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
  void SkipHeader() {
    Take(3 * sizeof(std::uint32_t));  // seq, stamp
    Block();                          // frame_id
  }
};

/// Says whether the message has brought a frame or a camera that was not there.
bool Collect(const BagConnection& connection, std::string_view message, int max_frames,
             const std::string& name, RosContent* content) {
  if (connection.type == "sensor_msgs/Image") {
    const RosImage image = ReadImage(BagReader(message, name));
    if (!IsDepth(connection.topic, image.encoding)) return false;
    RecordedDepth& stream = content->streams[connection.topic];
    stream.stream = connection.topic;
    if (image.encoding == "32FC1") stream.depth_scale = 1;
    if (static_cast<int>(stream.frames.size()) >= max_frames) return false;
    stream.frames.push_back(DecodeImage(image, name));
    return true;
  }
  if (connection.type == "sensor_msgs/CameraInfo") {
    return content->infos.emplace(connection.topic, ReadCameraInfo(BagReader(message, name), name))
        .second;
  }
  if (connection.type == "std_msgs/Float32") {
    if (IsDepthUnits(connection.topic))
      content->units[connection.topic] = BagReader(message, name).Value<float>();
  } else if (connection.type == "diagnostic_msgs/KeyValue" && IsDeviceInfo(connection.topic)) {
    BagReader reader(message, name);
    const std::string key = reader.Text();
    content->devices[connection.topic].emplace(key, reader.Text());
  }
  return false;
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
    // Asked after what may complete it alone: it goes through all connections.
    return !Collect(connection, message, max_frames, name, &content) ||
           !IsComplete(content, bag, max_frames);
  });
  return DescribeStreams(std::move(content), name);
}

}  // namespace volalign::formats_internal
