#pragma once

// The formats: one pair of functions each, for texts in memory. Readers throw DataError with the
// file's `name` in the message. Not for callers of ReadPoses and WritePoses.

#include <map>
#include <string>
#include <vector>

#include "core/geometry/procrustes.h"
#include "infer/formats/poses/sensor_pose.h"

namespace volalign::poses_internal {

using Poses = std::vector<SensorPose>;

/// The rows of a matrix as text, a line each.
std::string RowsOf(const Eigen::MatrixXd& matrix);

/// The frame of a file's poses, and their camera. The codecs change neither: they write poses as
/// given, and name both in the file.
struct FileFrame {
  std::string world = "y up, right-handed";
  std::string name = "structure";  ///< of the world, in one word
  bool colour = false;             ///< poses of the colour cameras
};

/// Parses a number. Throws DataError, with the place, for a word that is no finite number.
double ParseNumber(const std::string& word, const std::string& place);

inline constexpr char kDepthConvention[] =
    "true depth = depth_gain * measured depth + depth_offset_m, and the poses belong to true "
    "depths";

/// Comments with this convention and a line for each sensor whose depths are corrected; else "".
std::string DepthComments(const Poses& poses);
/// Reads the corrections that DepthComments wrote into `text`, by the sensors' names. Throws
/// DataError for a word that is no number.
void ReadDepthComments(const std::string& text, const std::string& name, Poses* poses);

/// The texts of a folder's files, by name. Readers pass over those of other formats.
using Files = std::map<std::string, std::string>;
/// May it be a file of a format that is a folder, by its name?
bool IsFileOfPoses(const std::string& file);

/// The width or height of a picture, in a format whose numbers are all read alike. Throws
/// DataError, with `place` in its message, for anything but a whole number from 1 on.
int PixelCount(double value, const std::string& place);

std::string WritePosesJson(const Poses& poses, const FileFrame& frame);
Poses ReadPosesJson(const std::string& text, const std::string& name);

std::string WriteOpen3d(const Poses& poses, const FileFrame& frame);
Poses ReadOpen3d(const std::string& text, const std::string& name);

std::string WriteUnity(const Poses& poses, const FileFrame& frame);
Poses ReadUnity(const std::string& text, const std::string& name);

std::string WriteOpen3dLog(const Poses& poses, const FileFrame& frame);
Poses ReadOpen3dLog(const std::string& text, const std::string& name);

std::string WriteTum(const Poses& poses, const FileFrame& frame);
Poses ReadTum(const std::string& text, const std::string& name);

std::string WriteCsv(const Poses& poses, const FileFrame& frame);
Poses ReadCsv(const std::string& text, const std::string& name);

std::string WriteOpencv(const Poses& poses, const FileFrame& frame);
Poses ReadOpencv(const std::string& text, const std::string& name);

std::string WriteRos(const Poses& poses, const FileFrame& frame);
Poses ReadRos(const std::string& text, const std::string& name);

/// A launch file of ROS 2, and joints of a robot's description, both in the world of ros.
std::string WriteRosLaunch(const Poses& poses, const FileFrame& frame);
std::string WriteUrdf(const Poses& poses, const FileFrame& frame);

/// Writes files for VolumetricCapture. Their world has z up, as in ros.
Files WriteVolumetricCapture(const Poses& poses, const FileFrame& frame);
Poses ReadVolumetricCapture(const Files& files);

std::string WriteCwipc(const Poses& poses, const FileFrame& frame);
Poses ReadCwipc(const std::string& text, const std::string& name);

/// Poses of the cameras whose points LiveScan3D transforms.
Files WriteLivescan(const Poses& poses, const FileFrame& frame);
Poses ReadLivescan(const Files& files);

Files WriteColmap(const Poses& poses, const FileFrame& frame);
Poses ReadColmap(const Files& files);

/// Per sensor, a NumPy file NAME.npy, float32 [height, width, 4]: x and y of the pixel's ray on the
/// plane z = 1, sensor frame, NaN without one; depth_gain; depth_offset_m. All need intrinsics.
Files WriteDepthCorrection(const Poses& poses, const FileFrame& frame);

/// The pose with which uncorrected depths fit best, and what it leaves, for points up to 1 m from
/// the structure's origin. Throws ConfigError if none of them is before the sensor.
ProcrustesResult PoseForRawDepth(const SensorPose& sensor);

/// m: by how much the intrinsics that were given misplace a visible point up to 1 m from the
/// structure's origin. 0 if there are no others.
double LensShift(const SensorPose& sensor);

}  // namespace volalign::poses_internal
