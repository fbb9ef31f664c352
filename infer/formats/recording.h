#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/camera.h"
#include "core/geometry/colour_camera.h"
#include "infer/formats/depth_file.h"

namespace volalign {

/// A depth stream of a recording: its first frames, and what the recording says about them, in
/// texts that are Shortened.
struct RecordedDepth {
  std::string stream;  ///< the recording's own name: a topic, a track
  std::string device;  ///< "Intel RealSense D415"; empty where the recording does not say
  std::string kind;    ///< a name of configs/intrinsics.yaml, or empty
  std::string serial;
  std::optional<Intrinsics> intrinsics;
  std::optional<double> depth_scale;   ///< metres per unit
  std::string depth_scale_source;      ///< why that, for a reader
  std::optional<ColourCamera> colour;  ///< where the recording says where it is
  std::vector<StoredDepth> frames;
};

/// Whether the file begins as a recording that ReadRecording knows. False where it cannot be read.
bool IsRecording(const std::filesystem::path& path);

/// The depth streams of a recording, each with its first `max_frames` frames, in the recording's
/// order of streams:
/// - RealSense .bag and other bags of ROS 1 (format 2.0; chunks plain, bz2 or lz4): topics of
///   sensor_msgs/Image of 16 bits whose name has "depth", or of 16UC1 or 32FC1, with the
///   CameraInfo and the option "Depth Units" that share most of the topic's path. Without that
///   option ROS's own convention holds: integers are millimetres, floats metres (REP 118);
/// - bags of ROS 2 in SQLite (.db3), as RealSense's recorder writes them today: images of the same
///   encodings, or compressed as PNG ("16UC1; compressedDepth png");
/// - .bag of OrbbecViewer and the Orbbec SDK: topics /cam/sensor_N/frameType_N whose images are
/// z16,
///   or mono16 of the type of depth, with the stream profiles' intrinsics;
/// - MCAP with messages of ROS 1 or ROS 2, its chunks plain, zstd or lz4;
/// - Azure Kinect .mkv: the track DEPTH (b16g), or one of 16-bit grey where none has a name, whose
///   unit is the millimetre, with the attached calibration.json.
/// Throws IoError, or DataError where the file is damaged, or has no depth stream with a frame.
std::vector<RecordedDepth> ReadRecording(const std::filesystem::path& path, int max_frames);

namespace formats_internal {

struct Recording {
  std::vector<RecordedDepth> streams;  ///< of depth, with a frame each
  std::vector<std::string> contents;   ///< what else is in it: "/color/image (sensor_msgs/Image)"
};

Recording ReadBagRecording(const std::filesystem::path& path, int max_frames);
/// Gives up, with DataError, after `most_steps` of SQLite's machine: some 10^8 a second.
Recording ReadRos2Recording(const std::filesystem::path& path, int max_frames,
                            std::int64_t most_steps);
Recording ReadMkvRecording(const std::filesystem::path& path, int max_frames);
Recording ReadMcapRecording(const std::filesystem::path& path, int max_frames);

/// The name in configs/intrinsics.yaml of a device's own name, or "".
std::string KindOfDevice(const std::string& device);

}  // namespace formats_internal

}  // namespace volalign
