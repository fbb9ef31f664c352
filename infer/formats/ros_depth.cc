#include "infer/formats/ros_depth.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <utility>

#include "core/base/error.h"
#include "core/base/text.h"
#include "infer/formats/lens_names.h"

namespace volalign::formats_internal {

namespace {

constexpr double kMillimetre = 0.001;

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

bool IsColour(const std::string& topic) {
  const std::string lower = Lower(topic);
  return lower.find("color") != std::string::npos || lower.find("colour") != std::string::npos ||
         lower.find("rgb") != std::string::npos;
}

/// p_to = T p_from, along the transforms; none where they do not join the frames.
std::optional<Pose> Between(const std::vector<RosTransform>& transforms, const std::string& from,
                            const std::string& to) {
  std::map<std::string, Pose> known = {{from, Pose::Identity()}};  // p_frame = T p_from
  for (bool grown = true; grown && !known.count(to);) {
    grown = false;
    for (const RosTransform& transform : transforms) {
      const auto parent = known.find(transform.parent), child = known.find(transform.child);
      if ((parent == known.end()) == (child == known.end())) continue;
      if (parent == known.end()) {
        known.emplace(transform.parent, transform.parent_from_child * child->second);
      } else {
        known.emplace(transform.child, transform.parent_from_child.inverse() * parent->second);
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

/// A unit that was stored in single precision: 0.001 instead of 0.0010000000474974513.
double AsWritten(double unit) { return std::strtod(fmt::format("{:.6g}", unit).c_str(), nullptr); }

void Describe(const RosContent& content, const std::string& name, RecordedDepth* stream) {
  if (const CameraInfo* info = Nearest(content.infos, stream->stream)) {
    stream->intrinsics = IntrinsicsOf(*info, stream->stream, name);
    stream->colour = ColourOf(content, stream->stream, info->frame, name);
  }
  if (const double* unit = Nearest(content.units, stream->stream)) {
    const double written = AsWritten(*unit);
    // What is no unit is none that is stated, and has to be given.
    stream->depth_scale.reset();
    if (written > 0 && std::isfinite(written)) stream->depth_scale = written;
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

/// Millimetres on the Femto sensors; on others the unit is a property of the device.
void DescribeOrbbec(const RosContent& content, const std::string& name, RecordedDepth* stream) {
  const OrbbecProperties& properties = content.properties;
  if (properties.frames_are_disparity) {
    throw DataError(fmt::format(
        "{}: {}: the images are disparities, of which the device was not to make depth itself; "
        "record with the device's disparity to depth on",
        name, stream->stream));
  }
  const auto device = content.devices.find(kOrbbecDevice);
  if (device != content.devices.end()) stream->device = device->second.at("name");
  stream->kind = KindOfDevice(stream->device);
  if (Lower(stream->device).find("femto") != std::string::npos) {
    stream->depth_scale = kMillimetre;
    stream->depth_scale_source = "the unit of the Femto sensors";
  } else if (properties.unit && *properties.unit > 0 && std::isfinite(*properties.unit)) {
    stream->depth_scale = AsWritten(*properties.unit);
    stream->depth_scale_source = "the depth unit among the device's recorded properties";
  }
  const auto profile = content.profiles.find(OrbbecStream(stream->stream));
  if (profile == content.profiles.end()) return;
  if (!profile->second.lens.empty())
    throw DataError(fmt::format("{}: {}: {}", name, stream->stream, profile->second.lens));
  stream->intrinsics = profile->second.intrinsics;
  stream->intrinsics->Validate(name + ": " + stream->stream);
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
  return encoding == "16UC1" || encoding == "32FC1" ||
         (encoding == "mono16" && Lower(topic).find("depth") != std::string::npos);
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

bool IsDeviceInfo(const std::string& topic) {
  return topic.rfind("/device_", 0) == 0 && topic.find("/info") == topic.find('/', 1);
}

bool IsDepthUnits(const std::string& topic) {
  const std::string lower = Lower(topic);
  return lower.find("depth units/value") != std::string::npos ||
         lower.find("depth_units/value") != std::string::npos;
}

bool IsStaticTransform(const std::string& topic) { return topic == "/tf_static"; }

bool IsStreamTransform(const std::string& topic) {
  return topic.rfind("/device_", 0) == 0 && topic.find("/tf/") != std::string::npos;
}

RosTransform StreamTransform(const std::string& topic, const Pose& stream_from_reference) {
  const std::size_t end = topic.find("/tf/");
  return {topic.substr(0, topic.find('/', 1)) + topic.substr(end), topic.substr(0, end),
          stream_from_reference.inverse()};
}

Recording DescribeStreams(RosContent content, const std::string& name) {
  content.transforms.resize(std::min(content.transforms.size(), kMostTransforms));
  // The recorder of RealSense names no frames: a stream's path serves.
  for (auto& [topic, info] : content.infos) {
    const std::size_t end = topic.find("/info/camera_info");
    if (topic.rfind("/device_", 0) == 0 && end != std::string::npos)
      info.frame = topic.substr(0, end);
  }
  Recording recording;
  recording.contents.assign(content.contents.begin(), content.contents.end());
  for (auto& [topic, stream] : content.streams) {
    if (OrbbecStream(topic).empty()) {
      Describe(content, name, &stream);
    } else {
      DescribeOrbbec(content, name, &stream);
    }
    recording.streams.push_back(std::move(stream));
  }
  return recording;
}

}  // namespace volalign::formats_internal
