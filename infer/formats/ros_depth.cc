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

/// A unit that was stored in single precision: 0.001 instead of 0.0010000000474974513.
double AsWritten(double unit) { return std::strtod(fmt::format("{:.6g}", unit).c_str(), nullptr); }

void Describe(const RosContent& content, const std::string& name, RecordedDepth* stream) {
  if (const CameraInfo* info = Nearest(content.infos, stream->stream))
    stream->intrinsics = IntrinsicsOf(*info, stream->stream, name);
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

}  // namespace

bool IsDepth(const std::string& topic, const std::string& encoding) {
  return encoding == "16UC1" || encoding == "32FC1" ||
         (encoding == "mono16" && Lower(topic).find("depth") != std::string::npos);
}

StoredDepth DecodeImage(const RosImage& image, const std::string& name) {
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

bool IsDeviceInfo(const std::string& topic) {
  return topic.rfind("/device_", 0) == 0 && topic.find("/info") == topic.find('/', 1);
}

bool IsDepthUnits(const std::string& topic) {
  const std::string lower = Lower(topic);
  return lower.find("depth units/value") != std::string::npos ||
         lower.find("depth_units/value") != std::string::npos;
}

std::vector<RecordedDepth> DescribeStreams(RosContent content, const std::string& name) {
  std::vector<RecordedDepth> streams;
  for (auto& [topic, stream] : content.streams) {
    Describe(content, name, &stream);
    streams.push_back(std::move(stream));
  }
  return streams;
}

}  // namespace volalign::formats_internal
