// Depth streams of a bag: what RealSense's recorder writes, and depth images of ROS 1.

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdint>
#include <cstring>

#include "core/error.h"
#include "infer/io/formats/byte_reader.h"
#include "infer/io/formats/lens_names.h"
#include "infer/io/formats/recording.h"
#include "infer/io/formats/ros_bag.h"

namespace volalign::formats_internal {

namespace {

constexpr double kMillimetre = 0.001;

std::string Lower(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

/// std_msgs/Header.
void SkipHeader(ByteReader* reader) {
  reader->Take(3 * sizeof(std::uint32_t));  // seq, stamp
  reader->Block();                          // frame_id
}

struct ImageMessage {
  std::uint32_t width = 0, height = 0, step = 0;
  std::string encoding;
  bool big_endian = false;
  std::string_view data;
};

ImageMessage ParseImage(std::string_view message, const std::string& name) {
  ByteReader reader(message, name);
  SkipHeader(&reader);
  ImageMessage image;
  image.height = reader.Value<std::uint32_t>();
  image.width = reader.Value<std::uint32_t>();
  image.encoding = std::string(reader.Block());
  image.big_endian = reader.Value<std::uint8_t>() != 0;
  image.step = reader.Value<std::uint32_t>();
  image.data = reader.Block();
  return image;
}

bool IsDepth(const std::string& topic, const std::string& encoding) {
  return encoding == "16UC1" || encoding == "32FC1" ||
         (encoding == "mono16" && Lower(topic).find("depth") != std::string::npos);
}

StoredDepth DecodeImage(const ImageMessage& image, const std::string& name) {
  RequireSize(image.width, image.height, name);
  const bool is_float = image.encoding == "32FC1";
  const std::size_t sample = is_float ? 4 : 2;
  if (image.step < sample * image.width ||
      image.data.size() < static_cast<std::size_t>(image.step) * image.height)
    throw DataError(fmt::format("{}: damaged: {} bytes are no image of {}x{}", name,
                                image.data.size(), image.width, image.height));
  StoredDepth depth;
  depth.whole_numbers = !is_float;
  depth.values = Image<float>(static_cast<int>(image.width), static_cast<int>(image.height));
  for (std::uint32_t v = 0; v < image.height; ++v) {
    for (std::uint32_t u = 0; u < image.width; ++u) {
      const char* at = image.data.data() + static_cast<std::size_t>(image.step) * v + sample * u;
      std::uint32_t bits = 0;
      for (std::size_t i = 0; i < sample; ++i) {
        const auto byte = static_cast<std::uint8_t>(at[image.big_endian ? sample - 1 - i : i]);
        bits |= static_cast<std::uint32_t>(byte) << (8 * i);
      }
      float value = static_cast<float>(bits);
      if (is_float) std::memcpy(&value, &bits, sizeof(value));
      // REP 118: NaN and infinities are no measurement, as 0 is.
      depth.values(static_cast<int>(u), static_cast<int>(v)) =
          value > 0 && value < 1e6f ? value : 0;
    }
  }
  return depth;
}

/// sensor_msgs/CameraInfo. `rectified`: of an image that was rectified: then P is its camera.
struct CameraInfo {
  Intrinsics raw, rectified;
  std::string model;
};

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
  info.rectified = info.raw;
  info.raw.fx = k[0];
  info.raw.cx = k[2];
  info.raw.fy = k[4];
  info.raw.cy = k[5];
  info.rectified.fx = p[0];
  info.rectified.cx = p[2];
  info.rectified.fy = p[5];
  info.rectified.cy = p[6];
  info.rectified.distortion.assign(5, 0.0);
  return info;
}

Intrinsics IntrinsicsOf(const CameraInfo& info, const std::string& topic, const std::string& name) {
  const bool has_lens = std::any_of(info.raw.distortion.begin(), info.raw.distortion.end(),
                                    [](double x) { return x != 0; });
  // ROS calls an image "..._rect..." once the lens is taken out of it.
  if (has_lens && Lower(topic).find("rect") != std::string::npos) {
    info.rectified.Validate(name + ": " + topic);
    return info.rectified;
  }
  Intrinsics intrinsics = info.raw;
  intrinsics.distortion = NamedLens(info.model, info.raw.distortion, name + ": " + topic);
  intrinsics.Validate(name + ": " + topic);
  return intrinsics;
}

/// Number of path parts that two topics share from the front.
std::size_t SharedParts(const std::string& a, const std::string& b) {
  std::size_t shared = 0;
  for (std::size_t i = 0; i < std::min(a.size(), b.size()) && a[i] == b[i]; ++i)
    if (a[i] == '/') ++shared;
  return shared;
}

/// The value whose topic shares most with `topic`; null where none shares a part.
template <class T>
const T* Nearest(const std::map<std::string, T>& by_topic, const std::string& topic) {
  const T* nearest = nullptr;
  std::size_t most = 1;  // the first "/" alone is nothing
  for (const auto& [other, value] : by_topic) {
    const std::size_t shared = SharedParts(topic, other);
    if (shared <= most) continue;
    most = shared;
    nearest = &value;
  }
  return nearest;
}

/// What of a bag matters here, as it is read.
struct BagContent {
  std::map<std::string, RecordedDepth> streams;  // by topic
  std::map<std::string, CameraInfo> infos;
  std::map<std::string, double> units;                                // metres
  std::map<std::string, std::map<std::string, std::string>> devices;  // of /device_0/info
};

/// "/device_0/info", of the recorder of RealSense.
bool IsDeviceInfo(const std::string& topic) {
  return topic.rfind("/device_", 0) == 0 && topic.find("/info") == topic.find('/', 1);
}

void Collect(const BagConnection& connection, std::string_view message, int max_frames,
             const std::string& name, BagContent* content) {
  if (connection.type == "sensor_msgs/Image") {
    const ImageMessage image = ParseImage(message, name);
    if (!IsDepth(connection.topic, image.encoding)) return;
    RecordedDepth& stream = content->streams[connection.topic];
    stream.stream = connection.topic;
    if (static_cast<int>(stream.frames.size()) < max_frames)
      stream.frames.push_back(DecodeImage(image, name));
    if (image.encoding == "32FC1") stream.depth_scale = 1;
  } else if (connection.type == "sensor_msgs/CameraInfo") {
    content->infos.emplace(connection.topic, ParseCameraInfo(message, name));
  } else if (connection.type == "std_msgs/Float32") {
    const std::string topic = Lower(connection.topic);
    if (topic.find("depth units/value") != std::string::npos ||
        topic.find("depth_units/value") != std::string::npos)
      content->units[connection.topic] = ByteReader(message, name).Value<float>();
  } else if (connection.type == "diagnostic_msgs/KeyValue" && IsDeviceInfo(connection.topic)) {
    ByteReader reader(message, name);
    const std::string key(reader.Block());
    content->devices[connection.topic].emplace(key, std::string(reader.Block()));
  }
}

/// Whether nothing more is to come: every image topic that may be depth has all its frames.
bool IsComplete(const BagContent& content, const RosBag& bag, int max_frames) {
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

/// A unit that was stored in single precision: 0.001 instead of 0.0010000000474974513.
double AsWritten(double unit) { return std::stod(fmt::format("{:.6g}", unit)); }

void Describe(const BagContent& content, const std::string& name, RecordedDepth* stream) {
  if (const CameraInfo* info = Nearest(content.infos, stream->stream))
    stream->intrinsics = IntrinsicsOf(*info, stream->stream, name);
  if (const double* unit = Nearest(content.units, stream->stream)) {
    stream->depth_scale = AsWritten(*unit);
    stream->depth_scale_source = "the recording's option Depth Units";
  } else {
    stream->depth_scale = stream->depth_scale.value_or(kMillimetre);
    stream->depth_scale_source = "ROS's convention for depth images (REP 118)";
  }
  if (const auto* device = Nearest(content.devices, stream->stream)) {
    for (const auto& [key, value] : *device) {
      if (Lower(key) == "name") stream->device = value;
      if (Lower(key) == "serial number") stream->serial = value;
    }
  }
  stream->kind = KindOfDevice(stream->device);
}

}  // namespace

std::vector<RecordedDepth> ReadBagRecording(const std::filesystem::path& path, int max_frames) {
  const std::string name = path.string();
  RosBag bag(path);
  BagContent content;
  bag.ForEachMessage([&](const BagConnection& connection, std::string_view message) {
    Collect(connection, message, max_frames, name, &content);
    return !IsComplete(content, bag, max_frames);
  });
  std::vector<RecordedDepth> streams;
  for (auto& [topic, stream] : content.streams) {
    Describe(content, name, &stream);
    streams.push_back(std::move(stream));
  }
  return streams;
}

}  // namespace volalign::formats_internal
