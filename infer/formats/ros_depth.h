#pragma once

// Depth images as ROS has them, whatever the form of their messages.

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/error.h"
#include "core/geometry/camera.h"
#include "infer/formats/recording.h"

namespace volalign::formats_internal {

/// sensor_msgs/Image.
struct RosImage {
  std::uint32_t width = 0, height = 0, step = 0;
  std::string encoding;
  bool big_endian = false;
  std::string_view data;
};

/// Whether an image of that encoding is depth.
bool IsDepth(const std::string& topic, const std::string& encoding);

/// Values as stored; throws DataError for too few bytes.
StoredDepth DecodeImage(const RosImage& image, const std::string& name);

/// sensor_msgs/CameraInfo. `rectified` is the camera of an image that was rectified.
struct CameraInfo {
  Intrinsics raw, rectified;
  std::string model;
};

// The messages have the same fields in ROS 1 and 2, in bytes of different forms. Reader:
// SkipHeader() for a std_msgs/Header, Value<T>(), Text() and Bytes().

template <class Reader>
RosImage ReadImage(Reader reader) {
  reader.SkipHeader();
  RosImage image;
  image.height = reader.template Value<std::uint32_t>();
  image.width = reader.template Value<std::uint32_t>();
  image.encoding = reader.Text();
  image.big_endian = reader.template Value<std::uint8_t>() != 0;
  image.step = reader.template Value<std::uint32_t>();
  image.data = reader.Bytes();
  return image;
}

/// Throws DataError, which `name` begins, for what is no lens.
template <class Reader>
CameraInfo ReadCameraInfo(Reader reader, const std::string& name) {
  reader.SkipHeader();
  CameraInfo info;
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

/// What of a recording matters, as it is read.
struct RosContent {
  std::map<std::string, RecordedDepth> streams;  // by topic
  std::map<std::string, CameraInfo> infos;
  std::map<std::string, double> units;                                // metres
  std::map<std::string, std::map<std::string, std::string>> devices;  // of /device_0/info
};

/// Whether it is "/device_0/info", of the recorder of RealSense.
bool IsDeviceInfo(const std::string& topic);

/// Whether the topic has the option Depth Units of the recorder of RealSense.
bool IsDepthUnits(const std::string& topic);

/// The streams, each with what is said of it by the topics that share most of its path. `name`
/// begins every message; throws DataError.
std::vector<RecordedDepth> DescribeStreams(RosContent content, const std::string& name);

}  // namespace volalign::formats_internal
