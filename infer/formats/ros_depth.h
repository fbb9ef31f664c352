#pragma once

// Depth images of ROS, whatever the form of their messages.

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/geometry/camera.h"
#include "infer/formats/poses/sensor_pose.h"
#include "infer/formats/read_budget.h"
#include "infer/formats/recording.h"

namespace volalign::formats_internal {

/// sensor_msgs/Image.
struct RosImage {
  std::string frame;  ///< frame of its points, by the name in transforms
  std::uint32_t width = 0, height = 0, step = 0;
  std::string encoding;
  bool big_endian = false;
  std::string_view data;
};

/// Is an image of that encoding depth? An image whose topic's name says infrared or the like is
/// not.
bool IsDepth(const std::string& topic, const std::string& encoding);

/// Most bytes of a topic's name, and of a text in a message.
inline constexpr std::size_t kMostTopicBytes = 1000;
inline constexpr std::size_t kMostTextBytes = std::size_t{1} << 16;

/// `bytes` as a text. Throws DataError, which `name` begins, for one that is longer than `most`.
std::string BoundedText(std::string_view bytes, const std::string& name,
                        std::size_t most = kMostTextBytes);

/// Numbers of the types of streams (OBStreamType) in recordings of the Orbbec SDK.
inline constexpr char kOrbbecColour[] = "2", kOrbbecDepth[] = "3";
inline constexpr char kOrbbecDevice[] = "/cam/deviceInfo", kOrbbecProperty[] = "/cam/property";
/// "3" of "/cam/sensor_3/frameType_3" and of "/cam/streamProfileType_3"; "" of other topics.
std::string OrbbecStream(const std::string& topic);
std::string OrbbecProfileNumber(const std::string& topic);

/// Values as stored; throws DataError for too few bytes.
StoredDepth DecodeImage(const RosImage& image, const std::string& name);

/// sensor_msgs/CameraInfo. `rectified`: the camera of a rectified image.
struct CameraInfo {
  Intrinsics raw, rectified;
  std::string model, frame;  ///< frame of its points, by the name in transforms
};

/// Most transforms of a recording. A device has some ten, and joining them takes quadratic time.
inline constexpr std::size_t kMostTransforms = 1000;

/// parent_from_child by the names of both frames: geometry_msgs/TransformStamped.
using RosTransforms = std::map<std::pair<std::string, std::string>, Pose>;

// The messages have the same fields in ROS 1 and 2, in bytes of different forms. A Reader has
// Value<T>(), Text(), Bytes(), and Header(), which reads a std_msgs/Header and returns the frame's
// name.

template <class Reader>
RosImage ReadImage(Reader reader) {
  RosImage image;
  image.frame = reader.Header();
  image.height = reader.template Value<std::uint32_t>();
  image.width = reader.template Value<std::uint32_t>();
  image.encoding = reader.Text();
  image.big_endian = reader.template Value<std::uint8_t>() != 0;
  image.step = reader.template Value<std::uint32_t>();
  image.data = reader.Bytes();
  return image;
}

/// Throws DataError, which `name` begins, for an impossible lens.
template <class Reader>
CameraInfo ReadCameraInfo(Reader reader, const std::string& name) {
  CameraInfo info;
  info.frame = reader.Header();
  info.raw.height = static_cast<int>(reader.template Value<std::uint32_t>());
  info.raw.width = static_cast<int>(reader.template Value<std::uint32_t>());
  info.model = reader.Text();
  const auto count = reader.template Value<std::uint32_t>();
  if (count > 64) throw DataError(name + ": damaged: a lens of more than 64 coefficients");
  for (std::uint32_t i = 0; i < count; ++i)
    info.raw.distortion.push_back(reader.template Value<double>());
  std::array<double, 9> k, r;  // row by row, as p
  std::array<double, 12> p;
  for (double& x : k) x = reader.template Value<double>();
  for (double& x : r) x = reader.template Value<double>();
  for (double& x : p) x = reader.template Value<double>();
  const int width = info.raw.width, height = info.raw.height;
  info.raw = {width, height, k[0], k[4], k[2], k[5], info.raw.distortion};
  info.rectified = {width, height, p[0], p[5], p[2], p[6], std::vector<double>(5, 0.0)};
  return info;
}

/// geometry_msgs/Transform. None if it is no rigid motion, because depth does not need it.
template <class Reader>
std::optional<Pose> ReadTransform(Reader* reader) {
  std::array<double, 7> v;  // translation, quaternion x y z w
  for (double& x : v) x = reader->template Value<double>();
  try {
    return PoseFromQuaternion(v[6], v[3], v[4], v[5], {v[0], v[1], v[2]}, "");
  } catch (const DataError&) {
    return std::nullopt;
  }
}

/// Adds the first transform of each two frames, up to kMostTransforms.
void AddTransform(std::string parent, std::string child, const std::optional<Pose>& pose,
                  RosTransforms* transforms);

/// tf2_msgs/TFMessage. Throws DataError.
template <class Reader>
void ReadTransforms(Reader reader, const std::string& name, RosTransforms* transforms) {
  const auto count = reader.template Value<std::uint32_t>();
  if (count > kMostTransforms) throw DataError(name + ": damaged: a message of many transforms");
  for (std::uint32_t i = 0; i < count; ++i) {
    std::string parent = reader.Header(), child = reader.Text();
    AddTransform(std::move(parent), std::move(child), ReadTransform(&reader), transforms);
  }
}

/// The topic of the transforms that apply to the whole recording.
inline constexpr char kStaticTransforms[] = "/tf_static";

/// The topic "/device_0/sensor_1/Color_0/tf/0" of RealSense's recorder has the pose of the
/// reference stream 0 in that stream's frame. The transform names the streams by their paths. False
/// for other topics.
bool IsStreamTransform(const std::string& topic);
void AddStreamTransform(const std::string& topic, const std::optional<Pose>& stream_from_reference,
                        RosTransforms* transforms);

/// custom_msg/StreamProfileInfo of the Orbbec SDK (src/media/ros of OrbbecSDK v2): fixed arrays.
struct OrbbecProfile {
  Intrinsics intrinsics;
  std::string lens;  ///< why the lens of `intrinsics` cannot be used; else empty
  /// For the depth stream: its pose in the colour camera's frame.
  std::optional<Pose> colour_from_stream;
};

/// The device's settings in recordings of the Orbbec SDK that affect depth images.
struct OrbbecProperties {
  std::optional<double> unit;         ///< metres
  bool frames_are_disparity = false;  ///< the SDK makes them depth on playback
};

/// The images of a topic.
struct RosStream : RecordedDepth {
  std::string frame;  ///< of the first one
};

/// The relevant content of a recording, as it is read.
struct RosContent {
  std::map<std::string, RosStream> streams;  // by topic
  std::map<std::string, CameraInfo> infos;
  std::map<std::string, double> units;                                // metres
  std::map<std::string, std::map<std::string, std::string>> devices;  // of /device_0/info
  RosTransforms transforms;
  std::map<std::string, OrbbecProfile> profiles;  // by the number of the stream's type
  OrbbecProperties properties;
  std::map<std::string, std::string> contents;  // types by topic
};

/// Adds a pair of a device's description if it is its name or its serial number.
void AddDevicePair(const std::string& key, const std::string& value,
                   std::map<std::string, std::string>* device);

/// The constants of reading one recording.
struct RosReading {
  const std::string& name;  ///< begins every message
  int max_frames = 1;
  ReadBudget* budget;
};

/// Adds the frame that `decode` returns, unless the topic's stream has all its frames or cannot be
/// read. Throws DataError.
template <class Decode>
void AddFrame(const RosReading& reading, const std::string& frame, const Decode& decode,
              RosStream* stream) {
  if (!stream->problem.empty() ||
      stream->frames.size() >= static_cast<std::size_t>(reading.max_frames))
    return;
  if (stream->frames.empty()) stream->frame = frame;
  stream->frames.push_back(decode());
  reading.budget->Keep(BytesOf(stream->frames.back()), reading.name);
}

/// Adds an image if it is one of depth. Throws DataError.
void AddImage(const std::string& topic, const RosImage& image, const RosReading& reading,
              RosContent* content);

/// Adds the content of a message that both versions of ROS have: an image, a camera, or static
/// transforms. `type`: as in ROS 1. False for other messages. Throws DataError.
template <class Reader>
bool CollectCommon(const std::string& topic, const std::string& type, std::string_view message,
                   const RosReading& reading, RosContent* content) {
  const std::string& name = reading.name;
  if (type == "sensor_msgs/Image") {
    AddImage(topic, ReadImage(Reader(message, name)), reading, content);
  } else if (type == "sensor_msgs/CameraInfo") {
    if (content->infos.count(topic) == 0)
      content->infos.emplace(topic, ReadCameraInfo(Reader(message, name), name));
  } else if (type == "tf2_msgs/TFMessage" && topic == kStaticTransforms) {
    ReadTransforms(Reader(message, name), name, &content->transforms);
  } else {
    return false;
  }
  return true;
}

/// Is it "/device_0/sensor_0/Depth_0/camera_info", of the recorder of RealSense 2.58?
bool IsStreamCamera(const std::string& topic);

/// Is it "/device_0/info", of the recorder of RealSense?
bool IsDeviceInfo(const std::string& topic);

/// Does the topic have the option Depth Units of the recorder of RealSense?
bool IsDepthUnits(const std::string& topic);

/// Completes each stream by the topics that share most of its path. `name` begins every message.
/// Throws DataError.
Recording DescribeStreams(RosContent content, const std::string& name);

/// Adds the relevant content of a message of ROS 1. Throws DataError.
void CollectRos1(const std::string& topic, const std::string& type, std::string_view message,
                 const RosReading& reading, RosContent* content);
/// The same for a message of ROS 2 (CDR), plain or packed by zstd.
void CollectRos2(const std::string& topic, const std::string& type, std::string_view message,
                 const RosReading& reading, RosContent* content);

/// Does every stream have all its frames, or cannot be read?
bool HasAllFrames(const RosContent& content, int max_frames);
/// Was the camera of every stream that can be read found?
bool HaveCameras(const RosContent& content);

}  // namespace volalign::formats_internal
