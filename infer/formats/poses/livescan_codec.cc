// LiveScan3D's calibration_SERIAL.txt, by its own reader and its use of the numbers
// (github.com/MarekKowalski/LiveScan3D, src/LiveScanClient: LoadCalibration in calibration.cpp,
// StoreFrame in liveScanClient.cpp). It has T, the rows of R, the number of a marker, and whether
// the sensor is calibrated. A point of the camera, in metres, goes to R (p + T).

#include <fmt/format.h>

#include <array>
#include <filesystem>
#include <locale>
#include <sstream>

#include "core/base/error.h"
#include "infer/formats/poses/codecs.h"

namespace volalign::poses_internal {

namespace {

constexpr char kBegin[] = "calibration_";
constexpr char kEnd[] = ".txt";
constexpr int kMarker = 0;  // read by the program, but not used for its clouds
/// Numbers and words of the later form: two 4x4 matrices, the marker, whether calibrated.
constexpr std::size_t kLaterForm = 34;

std::string NameOf(const std::string& file) {
  std::string name = file.substr(sizeof(kBegin) - 1);
  const std::size_t end = name.rfind(kEnd);
  if (end != std::string::npos && end + sizeof(kEnd) - 1 == name.size()) name.resize(end);
  return name;
}

std::size_t CountWords(const std::string& text) {
  std::istringstream stream(text);
  std::size_t count = 0;
  for (std::string word; stream >> word;) ++count;
  return count;
}

Pose WorldFromCamera(const std::string& text, const std::string& file) {
  if (CountWords(text) >= kLaterForm) {
    throw DataError(
        fmt::format("{}: this newer form of the file, with two 4x4 matrices, depends on settings "
                    "of the server; only the older form, with a vector and a 3x3 matrix, is read",
                    file));
  }
  // LiveScan3D reads the longest possible number each time. It writes the matrix without blanks,
  // and can read it because each number but 1 begins with a zero that the one before may take.
  std::istringstream stream(text);
  stream.imbue(std::locale::classic());  // whatever the process's
  std::array<double, 12> v{};
  for (double& number : v) {
    if (!(stream >> number))
      throw DataError(fmt::format("{}: not 12 numbers, a vector and a 3x3 matrix", file));
  }
  int marker = 0, calibrated = 0;
  if (!(stream >> marker >> calibrated))
    throw DataError(file + ": the marker and whether it is calibrated (1) are missing at the end");
  if (calibrated != 1)
    throw DataError(file + ": the last number is not 1: the sensor was not calibrated");
  const Eigen::Vector3d t(v[0], v[1], v[2]);
  const Eigen::Matrix3d r = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(&v[3]);
  return PoseFromRotation(r, r * t, file);
}

}  // namespace

bool IsFileOfPoses(const std::string& file) {
  return file.rfind(kBegin, 0) == 0 || file == "cameras.txt" || file == "images.txt" ||
         std::filesystem::path(file).extension() == ".extrinsics";
}

Files WriteLivescan(const Poses& poses, const FileFrame& /*frame*/) {
  Files files;
  for (const SensorPose& sensor : poses) {
    const Pose& pose = sensor.structure_from_sensor;
    files[kBegin + sensor.name + kEnd] =
        RowsOf((pose.linear().transpose() * pose.translation()).transpose()) +
        RowsOf(pose.linear()) + fmt::format("{}\n1\n", kMarker);
  }
  return files;
}

Poses ReadLivescan(const Files& files) {
  Poses poses;
  for (const auto& [file, text] : files) {
    if (file.rfind(kBegin, 0) != 0) continue;
    poses.push_back({NameOf(file), WorldFromCamera(text, file)});
  }
  if (poses.empty()) throw DataError("the folder has no file calibration_SERIAL.txt");
  return poses;
}

}  // namespace volalign::poses_internal
