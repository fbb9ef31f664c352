#include "infer/formats/ros_depth.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "core/base/error.h"
#include "core/base/number.h"
#include "core/base/text.h"
#include "core/geometry/lens.h"
#include "infer/formats/depth_file.h"
#include "infer/formats/intrinsics_file.h"

namespace volalign::formats_internal {

namespace {

constexpr double kMillimetre = 0.001;

/// Throws DataError, which `name` begins, for a lens that calibration cannot use.
void RequireUsable(const Intrinsics& intrinsics, const std::string& name) {
  intrinsics.Validate(name);
  RequireRays(intrinsics, name);
}

/// K[0] = 0: the camera is not calibrated (sensor_msgs/CameraInfo); P may still say all.
Intrinsics IntrinsicsOf(const CameraInfo& info, const std::string& topic, const std::string& name) {
  const bool has_lens = std::any_of(info.raw.distortion.begin(), info.raw.distortion.end(),
                                    [](double x) { return x != 0; });
  const bool calibrated = info.raw.fx != 0, rectified = info.rectified.fx != 0;
  if (!calibrated && !rectified)
    throw DataError(name + ": the camera is not calibrated (K[0] = 0)");
  // ROS calls an image "..._rect..." once the lens is taken out of it.
  if (!calibrated || (has_lens && Lower(topic).find("rect") != std::string::npos)) {
    RequireUsable(info.rectified, name);
    return info.rectified;
  }
  Intrinsics intrinsics = info.raw;
  intrinsics.distortion = NamedLens(info.model, info.raw.distortion, name);
  RequireUsable(intrinsics, name);
  return intrinsics;
}

/// Number of path parts that two topics share from the front.
std::size_t SharedParts(const std::string& a, const std::string& b) {
  std::size_t shared = 0;
  for (std::size_t i = 0; i < std::min(a.size(), b.size()) && a[i] == b[i]; ++i)
    if (a[i] == '/') ++shared;
  return shared;
}

/// The value whose topic shares most with `topic`; null if none shares a part.
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

/// Does a topic's or a frame's name mean the colour camera, or images registered to it?
bool IsColour(const std::string& name) {
  return HasWord(name, {"color", "colour", "rgb", "bgr", "registered"});
}

/// Are both in one namespace? ROS puts a camera beside its images.
bool AreSiblings(const std::string& a, const std::string& b) {
  return a.substr(0, a.rfind('/')) == b.substr(0, b.rfind('/'));
}

/// May the camera be that of the stream's images? The colour camera is never that of images that
/// are not registered to it. If both name their frame, it is the same, or both topics are siblings.
bool MayBeOf(const std::string& topic, const CameraInfo& info, const RosStream& stream) {
  const bool siblings = AreSiblings(topic, stream.stream);
  const bool alike = (IsColour(topic) || IsColour(info.frame)) ==
                     (IsColour(stream.stream) || IsColour(stream.frame));
  if (!alike) return false;
  if (siblings) return true;
  if (!info.frame.empty() && !stream.frame.empty()) return info.frame == stream.frame;
  return SharedParts(topic, stream.stream) > 1 && (IsColour(topic) || !IsNamedOtherwise(topic));
}

/// The likeliest of the possible cameras; the end of content.infos if there is none.
auto CameraOf(const RosContent& content, const RosStream& stream) {
  const Image<float>& image = stream.frames.front().values;
  auto best = content.infos.end();
  std::array<std::size_t, 3> best_score{};
  for (auto it = content.infos.begin(); it != content.infos.end(); ++it) {
    const auto& [topic, info] = *it;
    if (!MayBeOf(topic, info, stream)) continue;
    const bool fits = info.raw.width == image.width() && info.raw.height == image.height();
    const std::array<std::size_t, 3> score = {fits, AreSiblings(topic, stream.stream),
                                              SharedParts(topic, stream.stream)};
    if (best != content.infos.end() && score <= best_score) continue;
    best = it;
    best_score = score;
  }
  return best;
}

/// p_to = T p_from, along the transforms; none if they do not join the frames.
std::optional<Pose> Between(const RosTransforms& transforms, const std::string& from,
                            const std::string& to) {
  std::map<std::string, Pose> known = {{from, Pose::Identity()}};  // p_frame = T p_from
  for (bool grown = true; grown && !known.count(to);) {
    grown = false;
    for (const auto& [names, parent_from_child] : transforms) {
      const auto parent = known.find(names.first), child = known.find(names.second);
      if ((parent == known.end()) == (child == known.end())) continue;
      if (parent == known.end()) {
        known.emplace(names.first, parent_from_child * child->second);
      } else {
        known.emplace(names.second, parent_from_child.inverse() * parent->second);
      }
      grown = true;
    }
  }
  const auto found = known.find(to);
  return found == known.end() ? std::nullopt : std::optional(found->second);
}

std::optional<ColourCamera> ColourOf(const RosContent& content, const std::string& topic,
                                     const std::string& frame, const std::string& name) {
  std::map<std::string, CameraInfo> cameras;
  for (const auto& [other, info] : content.infos) {
    if (IsColour(other)) cameras.emplace(other, info);
  }
  const CameraInfo* info = Nearest(cameras, topic);
  if (!info || info->frame.empty() || frame.empty()) return std::nullopt;
  const std::optional<Pose> pose = Between(content.transforms, frame, info->frame);
  if (!pose) return std::nullopt;
  ColourCamera colour{*pose, std::nullopt};
  try {
    colour.intrinsics = IntrinsicsOf(*info, "", name);
  } catch (const DataError&) {
    // A lens that is not OpenCV's. Depth does not need it.
  }
  return colour;
}

/// A unit that was stored in single precision: 0.001 instead of 0.0010000000474974513. 0 if it is
/// no number.
double AsWritten(double unit) { return NumberOf(fmt::format("{:.6g}", unit)).value_or(0); }

/// Intrinsics, or why there are none.
void SetIntrinsics(const RosContent& content, const std::string& name, RosStream* stream) {
  const auto camera = CameraOf(content, *stream);
  if (camera == content.infos.end()) {
    if (content.infos.empty()) return;
    const auto& [topic, info] = *content.infos.begin();
    stream->intrinsics_problem = fmt::format(
        "{}: no camera_info is that of {} (frame_id \"{}\"); {} is of the frame_id \"{}\"", name,
        Shortened(stream->stream), Shortened(stream->frame), Shortened(topic),
        Shortened(info.frame));
    return;
  }
  const auto& [topic, info] = *camera;
  const std::string place = fmt::format("{}: {}", name, Shortened(topic));
  const Image<float>& image = stream->frames.front().values;
  stream->StateIntrinsics(topic, [&, &of = info] {
    Intrinsics intrinsics = IntrinsicsOf(of, stream->stream, place);
    if (intrinsics.width != image.width() || intrinsics.height != image.height()) {
      throw DataError(fmt::format("{} is for {}x{}, the images are {}x{}", place, intrinsics.width,
                                  intrinsics.height, image.width(), image.height()));
    }
    return intrinsics;
  });
  if (info.raw.fx == 0) stream->intrinsics_stated = false;
  stream->colour = ColourOf(content, stream->stream, info.frame, name);
}

void Describe(const RosContent& content, const std::string& name, RosStream* stream) {
  SetIntrinsics(content, name, stream);
  if (const double* unit = Nearest(content.units, stream->stream)) {
    stream->StateScale(AsWritten(*unit), "the recording's option Depth Units");
    // An impossible unit leaves no scale: the capture has to give it.
    if (!(*stream->depth_scale > 0)) stream->depth_scale.reset();
  } else {
    stream->depth_scale = stream->depth_scale.value_or(kMillimetre);
    stream->depth_scale_source = "ROS's convention for depth images (REP 118)";
  }
  if (const auto* device = Nearest(content.devices, stream->stream)) {
    for (const auto& [key, value] : *device)
      (key == "name" ? stream->device : stream->serial) = value;
  }
  stream->kind = KindOfDevice(stream->device);
}

/// The unit is millimetres on the Femto sensors, and a property of the device on others.
void DescribeOrbbec(const RosContent& content, const std::string& name, RecordedDepth* stream) {
  const OrbbecProperties& properties = content.properties;
  if (properties.frames_are_disparity) {
    stream->frames.clear();
    stream->problem =
        "the images are disparities, not depths; record with the device's disparity to depth on";
  }
  const auto device = content.devices.find(kOrbbecDevice);
  if (device != content.devices.end()) stream->device = device->second.at("name");
  stream->kind = KindOfDevice(stream->device);
  if (Lower(stream->device).find("femto") != std::string::npos) {
    stream->StateScale(kMillimetre, "the unit of the Femto sensors");
  } else if (properties.unit && *properties.unit > 0 && std::isfinite(*properties.unit)) {
    stream->StateScale(AsWritten(*properties.unit),
                       "the depth unit among the device's recorded properties");
  }
  const auto profile = content.profiles.find(OrbbecStream(stream->stream));
  if (profile == content.profiles.end()) return;
  const std::string place = fmt::format("{}: {}", name, stream->stream);
  stream->StateIntrinsics("the stream's profile", [&] {
    if (!profile->second.lens.empty())
      throw DataError(fmt::format("{}: {}", place, profile->second.lens));
    RequireUsable(profile->second.intrinsics, place);
    return profile->second.intrinsics;
  });
  if (!profile->second.colour_from_stream) return;
  stream->colour = ColourCamera{*profile->second.colour_from_stream, std::nullopt};
  const auto colour = content.profiles.find(kOrbbecColour);
  if (colour != content.profiles.end() && colour->second.lens.empty())
    stream->colour->intrinsics = colour->second.intrinsics;
}

}  // namespace

bool IsDepth(const std::string& topic, const std::string& encoding) {
  const std::string orbbec = OrbbecStream(topic);
  if (!orbbec.empty()) return encoding == "z16" || (encoding == "mono16" && orbbec == kOrbbecDepth);
  if (IsNamedOtherwise(topic)) return false;
  return encoding == "16UC1" || encoding == "32FC1" ||
         (encoding == "mono16" && Lower(topic).find("depth") != std::string::npos);
}

std::string BoundedText(std::string_view bytes, const std::string& name, std::size_t most) {
  if (bytes.size() > most)
    throw DataError(fmt::format("{}: damaged: a text of {} bytes", name, bytes.size()));
  return std::string(bytes);
}

std::string OrbbecStream(const std::string& topic) {
  const std::string begin = "/cam/sensor_", middle = "/frameType_";
  const std::size_t at = topic.find(middle);
  if (topic.rfind(begin, 0) != 0 || at == std::string::npos) return "";
  return topic.substr(at + middle.size());
}

std::string OrbbecProfileNumber(const std::string& topic) {
  const std::string begin = "/cam/streamProfileType_";
  return topic.rfind(begin, 0) == 0 ? topic.substr(begin.size()) : "";
}

StoredDepth DecodeImage(const RosImage& image, const std::string& name) {
  RequireSize(image.width, image.height, name);
  const bool is_float = image.encoding == "32FC1";  // else 16 bits: 16UC1, mono16, z16
  const SampleType type{is_float ? 'f' : 'u', is_float ? 4u : 2u, image.big_endian};
  if (image.step < type.size * image.width ||
      image.data.size() < static_cast<std::size_t>(image.step) * image.height)
    throw DataError(fmt::format("{}: damaged: {} bytes are no image of {}x{}", name,
                                image.data.size(), image.width, image.height));
  StoredDepth depth;
  depth.whole_numbers = !is_float;
  depth.values = Image<float>(static_cast<int>(image.width), static_cast<int>(image.height));
  for (std::uint32_t v = 0; v < image.height; ++v) {
    for (std::uint32_t u = 0; u < image.width; ++u) {
      const char* at = image.data.data() + static_cast<std::size_t>(image.step) * v + type.size * u;
      const float value = DecodeSample(type, at);
      // REP 118: NaN and infinities are no measurement, as 0 is.
      depth.values(static_cast<int>(u), static_cast<int>(v)) =
          value > 0 && value < 1e6f ? value : 0;
    }
  }
  return depth;
}

void AddImage(const std::string& topic, const RosImage& image, const RosReading& reading,
              RosContent* content) {
  const bool is_depth = IsDepth(topic, image.encoding);
  if (!is_depth && OrbbecStream(topic) != kOrbbecDepth) return;
  RosStream& stream = content->streams[topic];
  stream.stream = topic;
  if (!is_depth) {
    stream.problem = fmt::format(
        "depth encoded as \"{}\"; mono16 and z16 are read: record without compression of the depth",
        Shortened(image.encoding));
  }
  if (image.encoding == "32FC1") stream.depth_scale = 1;
  AddFrame(
      reading, image.frame, [&] { return DecodeImage(image, reading.name); }, &stream);
}

bool IsStreamCamera(const std::string& topic) {
  const std::string end = "/camera_info";
  const std::size_t at = topic.rfind(end);
  return topic.rfind("/device_", 0) == 0 && at != std::string::npos &&
         at + end.size() == topic.size();
}

bool IsDeviceInfo(const std::string& topic) {
  return topic.rfind("/device_", 0) == 0 && topic.find("/info") == topic.find('/', 1);
}

bool IsDepthUnits(const std::string& topic) {
  const std::string lower = Lower(topic);
  return lower.find("depth units/value") != std::string::npos ||
         lower.find("depth_units/value") != std::string::npos;
}

bool IsStreamTransform(const std::string& topic) {
  return topic.rfind("/device_", 0) == 0 && topic.find("/tf/") != std::string::npos;
}

void AddTransform(std::string parent, std::string child, const std::optional<Pose>& pose,
                  RosTransforms* transforms) {
  if (pose && transforms->size() < kMostTransforms)
    transforms->emplace(std::pair(std::move(parent), std::move(child)), *pose);
}

void AddStreamTransform(const std::string& topic, const std::optional<Pose>& stream_from_reference,
                        RosTransforms* transforms) {
  const std::size_t end = topic.find("/tf/");
  if (!stream_from_reference) return;
  AddTransform(topic.substr(0, topic.find('/', 1)) + topic.substr(end), topic.substr(0, end),
               stream_from_reference->inverse(), transforms);
}

void AddDevicePair(const std::string& key, const std::string& value,
                   std::map<std::string, std::string>* device) {
  const std::string lower = Lower(key);
  if (lower == "name" || lower == "serial number") device->emplace(lower, value);
}

bool HasAllFrames(const RosContent& content, int max_frames) {
  return !content.streams.empty() &&
         std::all_of(content.streams.begin(), content.streams.end(), [&](const auto& stream) {
           return !stream.second.problem.empty() ||
                  static_cast<int>(stream.second.frames.size()) >= max_frames;
         });
}

bool HaveCameras(const RosContent& content) {
  return std::all_of(content.streams.begin(), content.streams.end(), [&](const auto& stream) {
    return !stream.second.problem.empty() ||
           CameraOf(content, stream.second) != content.infos.end();
  });
}

Recording DescribeStreams(RosContent content, const std::string& name) {
  // RealSense's recorder uses names of frames without meaning; the stream's path takes their place.
  const auto rename = [](const std::string& topic, const char* end, std::string* frame) {
    const std::size_t at = topic.find(end);
    if (topic.rfind("/device_", 0) == 0 && at != std::string::npos) *frame = topic.substr(0, at);
  };
  for (auto& [topic, info] : content.infos) {
    rename(topic, "/camera_info", &info.frame);
    rename(topic, "/info/camera_info", &info.frame);
  }
  Recording recording;
  for (const auto& [topic, type] : content.contents)
    recording.contents.push_back(fmt::format("{} ({})", topic, type));
  for (auto& [topic, stream] : content.streams) {
    // The uncompressed images are there too.
    if (topic != stream.stream && content.streams.count(stream.stream) > 0) continue;
    rename(topic, "/image/", &stream.frame);
    if (!OrbbecStream(topic).empty()) {
      DescribeOrbbec(content, name, &stream);
    } else if (stream.problem.empty()) {
      Describe(content, name, &stream);
    }
    recording.streams.push_back(std::move(stream));
  }
  return recording;
}

}  // namespace volalign::formats_internal
