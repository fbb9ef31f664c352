#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/camera.h"
#include "core/geometry/colour_camera.h"
#include "infer/formats/depth_file.h"
#include "infer/formats/read_budget.h"

namespace volalign {

/// A depth stream of a recording: its first frames, and what the recording says about them, in
/// texts that are Shortened.
struct RecordedDepth {
  std::string stream;  ///< the recording's own name: a topic, a track
  std::string device;  ///< "Intel RealSense D415"; empty where the recording does not say
  std::string kind;    ///< a name of configs/intrinsics.yaml, or empty
  std::string serial;
  std::optional<Intrinsics> intrinsics;
  std::string intrinsics_source;   ///< whose they are: a topic, an attachment
  bool intrinsics_stated = false;  ///< as a calibration; else of a camera_info without one (K is 0)
  /// Why there are none although the recording says something of them; empty otherwise.
  std::string intrinsics_problem;
  std::optional<double> depth_scale;   ///< metres per unit
  bool depth_scale_stated = false;     ///< by the recording or for the device, not by a convention
  std::string depth_scale_source;      ///< why that, for a reader
  std::optional<ColourCamera> colour;  ///< where the recording says where it is
  std::vector<StoredDepth> frames;
  std::string problem;  ///< why its frames cannot be read; `frames` is empty then
};

/// How many frames make a still, where nobody says it.
inline constexpr int kDefaultFrames = 10;

/// Of a folder with the metadata.yaml of `ros2 bag record`, the names of the files of one
/// recording, in order; empty of any other.
std::vector<std::string> PartsOfRecording(const std::filesystem::path& folder);

/// Whether the file begins as a recording that ReadRecording knows. False where it cannot be read.
bool IsRecording(const std::filesystem::path& path);

/// The depth streams of a recording, each with its first `max_frames` frames, in the recording's
/// order of streams:
/// - RealSense .bag and other bags of ROS 1 (format 2.0; chunks plain, bz2 or lz4): topics of
///   sensor_msgs/Image of 16 bits whose name has "depth", or of 16UC1 or 32FC1 and not named as
///   infrared or the like, with the CameraInfo of their frame_id and the option "Depth Units" that
///   shares most of the topic's path. Without that option ROS's own convention holds: integers are
///   millimetres, floats metres (REP 118);
/// - bags of ROS 2 in SQLite (.db3), as RealSense's recorder writes them today: images of the same
///   encodings, or compressed as PNG ("16UC1; compressedDepth png") where the images themselves
///   are not there; each message plain or packed by zstd;
/// - .bag of OrbbecViewer and the Orbbec SDK: topics /cam/sensor_N/frameType_N whose images are
///   z16, or mono16 of the type of depth, with the stream profiles' intrinsics;
/// - MCAP with messages of ROS 1 or ROS 2, its chunks plain, zstd or lz4;
/// - Azure Kinect .mkv: the track DEPTH (b16g), or one of 16-bit grey where none has a name, whose
///   unit is the millimetre, with the attached calibration.json.
/// Each of them may be packed as a whole by zstd, as `ros2 bag` does. A lens that cannot be used is
/// no error, but a stream's intrinsics_problem, as a capture may give another one. Throws IoError,
/// or DataError where the file is damaged, asks for more than `budget`, or has no depth stream with
/// a frame that can be read.
std::vector<RecordedDepth> ReadRecording(const std::filesystem::path& path, int max_frames,
                                         ReadBudget* budget);
std::vector<RecordedDepth> ReadRecording(const std::filesystem::path& path, int max_frames);

namespace formats_internal {

struct Recording {
  std::vector<RecordedDepth> streams;  ///< of depth, with a frame each
  std::vector<std::string> contents;   ///< what else is in it: "/color/image (sensor_msgs/Image)"
};

/// `name` begins every message. SQLite's machine may do as many steps as the budget has bytes.
Recording ReadBagRecording(const std::filesystem::path& path, const std::string& name,
                           int max_frames, ReadBudget* budget);
Recording ReadRos2Recording(const std::filesystem::path& path, const std::string& name,
                            int max_frames, ReadBudget* budget);
Recording ReadMkvRecording(const std::filesystem::path& path, const std::string& name,
                           int max_frames, ReadBudget* budget);
Recording ReadMcapRecording(const std::filesystem::path& path, const std::string& name,
                            int max_frames, ReadBudget* budget);

/// The name in configs/intrinsics.yaml of a device's own name, or "".
std::string KindOfDevice(const std::string& device);

}  // namespace formats_internal

}  // namespace volalign
