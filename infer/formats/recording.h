#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/geometry/camera.h"
#include "infer/formats/depth_file.h"
#include "infer/formats/read_budget.h"

namespace volalign {

/// A depth stream of a recording: its first frames, and the recording's data on them. Texts are
/// Shortened.
struct RecordedDepth {
  std::string stream;  ///< the recording's own name: a topic, a track
  std::string device;  ///< "Intel RealSense D415"; empty if the recording does not have it
  std::string kind;    ///< a name of configs/intrinsics.yaml, or empty
  std::string serial;
  std::optional<Intrinsics> intrinsics;
  std::string intrinsics_source;   ///< their origin: a topic, an attachment
  bool intrinsics_stated = false;  ///< as a calibration; else by a camera_info without one (K is 0)
  /// the reason if the recording's intrinsics cannot be used; else empty
  std::string intrinsics_problem;
  std::optional<double> depth_scale;   ///< metres per unit
  bool depth_scale_stated = false;     ///< by the recording or for the device, not by a convention
  std::string depth_scale_source;      ///< its origin, for a reader
  std::optional<ColourCamera> colour;  ///< if the recording has its pose
  std::vector<StoredDepth> frames;
  std::string problem;  ///< why its frames cannot be read; `frames` is empty then

  /// By the recording or for the device.
  void StateScale(double metres, const std::string& source) {
    depth_scale = metres;
    depth_scale_source = source;
    depth_scale_stated = true;
  }
  /// Takes the intrinsics that `read` returns as those of a calibration, or says why there are none
  /// if it throws DataError.
  template <class Read>
  void StateIntrinsics(const std::string& source, const Read& read) {
    try {
      intrinsics = read();
      intrinsics_source = source;
      intrinsics_stated = true;
    } catch (const DataError& error) {
      intrinsics_problem = error.what();
    }
  }
};

/// Number of frames of a capture, if nobody gives it.
inline constexpr int kDefaultFrames = 10;

/// The names of the files of one recording, in order, in a folder with the metadata.yaml of `ros2
/// bag record`. Empty for any other folder.
std::vector<std::string> PartsOfRecording(const std::filesystem::path& folder);

/// Does the file begin as a recording that ReadRecording knows? False if it cannot be read.
bool IsRecording(const std::filesystem::path& path);

/// Reads the depth streams of a recording, each with its first `max_frames` frames, in the
/// recording's order of streams.
/// RealSense .bag and other bags of ROS 1 have format 2.0 and chunks that are plain, bz2 or lz4.
/// Topics are sensor_msgs/Image of 16 bits whose name has "depth", or of 16UC1 or 32FC1 and not
/// named as infrared or the like. They get the CameraInfo of their frame_id and the option "Depth
/// Units" that shares most of the topic's path. Without that option ROS's own convention applies:
/// integers are millimetres, floats metres (REP 118).
/// Bags of ROS 2 in SQLite (.db3) are as today's recorder of RealSense writes them. Images have the
/// same encodings, or are PNG ("16UC1; compressedDepth png") if the images themselves are not
/// there. Each message is plain or packed by zstd.
/// Bags of OrbbecViewer and the Orbbec SDK have topics /cam/sensor_N/frameType_N with images of
/// z16, or mono16 of the type of depth, and intrinsics in stream profiles.
/// MCAP has messages of ROS 1 or ROS 2, in chunks that are plain, zstd or lz4.
/// Azure Kinect .mkv has the track DEPTH (b16g), or one of 16-bit grey if none has a name, in
/// millimetres, and the attached calibration.json.
/// Each may be packed as a whole by zstd, as `ros2 bag` does. A lens that cannot be used is a
/// stream's intrinsics_problem, not an error: a capture may give another one. Throws IoError.
/// Throws DataError if the file is damaged, costs more than `budget`, or has no depth stream with a
/// readable frame.
std::vector<RecordedDepth> ReadRecording(const std::filesystem::path& path, int max_frames,
                                         ReadBudget* budget = nullptr);

namespace formats_internal {

struct Recording {
  std::vector<RecordedDepth> streams;  ///< of depth, with one or more frames each
  std::vector<std::string> contents;   ///< other contents: "/color/image (sensor_msgs/Image)"
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
