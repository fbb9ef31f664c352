// Formats that are plain columns of numbers.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>

#include "core/base/error.h"
#include "core/base/number.h"
#include "core/base/text.h"
#include "infer/formats/poses/codecs.h"

namespace volalign::poses_internal {

namespace {

constexpr char kExtension[] = ".extrinsics";
constexpr int kMostDistortion = 8;

/// Lines that are not empty, with their numbers, from 1.
struct Line {
  int number = 0;
  std::string text;
};
std::vector<Line> LinesOf(const std::string& text) {
  std::vector<Line> lines;
  std::istringstream stream(text);
  std::string line;
  for (int number = 1; std::getline(stream, line); ++number) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    if (line.find_first_not_of(" \t") != std::string::npos) lines.push_back({number, line});
  }
  return lines;
}

/// The numbers of a line, which must have exactly `count` of them.
std::vector<double> Numbers(const Line& line, std::size_t count, const std::string& name) {
  std::istringstream stream(line.text);
  std::vector<double> numbers;
  std::string word;
  while (stream >> word)
    numbers.push_back(ParseNumber(word, fmt::format("{}: line {}", name, line.number)));
  if (numbers.size() != count)
    throw DataError(fmt::format("{}: line {}: {} numbers instead of {}", name, line.number,
                                numbers.size(), count));
  return numbers;
}

/// The numbers of `rows` lines from `first` on.
Eigen::MatrixXd MatrixOf(const std::vector<Line>& lines, std::size_t first, Eigen::Index rows,
                         Eigen::Index cols, const std::string& name) {
  Eigen::MatrixXd matrix(rows, cols);
  for (Eigen::Index r = 0; r < rows; ++r) {
    const std::vector<double> row =
        Numbers(lines[first + static_cast<std::size_t>(r)], static_cast<std::size_t>(cols), name);
    matrix.row(r) = Eigen::Map<const Eigen::RowVectorXd>(row.data(), cols);
  }
  return matrix;
}

/// "# sensor I NAME", the name in formats without names; these comments come first.
std::string NameLine(std::size_t i, const std::string& name) {
  return fmt::format("# sensor {} {}\n", i, name);
}
std::string NameOf(const std::vector<Line>& lines, std::size_t i) {
  const std::string begin = fmt::format("# sensor {} ", i);
  for (const Line& line : lines) {
    if (line.text.compare(0, begin.size(), begin) == 0) return line.text.substr(begin.size());
  }
  return std::to_string(i);
}
std::vector<Line> WithoutComments(const std::vector<Line>& lines) {
  std::vector<Line> others;
  std::copy_if(lines.begin(), lines.end(), std::back_inserter(others),
               [](const Line& line) { return line.text[0] != '#'; });
  return others;
}

const char* const kCsvColumns[] = {"sensor", "x_m",   "y_m",   "z_m",      "qx",
                                   "qy",     "qz",    "qw",    "width_px", "height_px",
                                   "fx_px",  "fy_px", "cx_px", "cy_px"};

std::string CsvHeader() {
  std::string header;
  for (const char* column : kCsvColumns) header += std::string(header.empty() ? "" : ",") + column;
  for (int i = 0; i < kMostDistortion; ++i) header += fmt::format(",distortion_{}", i + 1);
  return header;
}

std::vector<std::string> CsvFields(const Line& line, const std::string& name) {
  std::vector<std::string> fields(1);
  bool inside = false;
  for (std::size_t i = 0; i < line.text.size(); ++i) {
    const char c = line.text[i];
    if (c == '"' && inside && i + 1 < line.text.size() && line.text[i + 1] == '"') {
      fields.back() += c;
      ++i;
    } else if (c == '"') {
      inside = !inside;
    } else if (c == ',' && !inside) {
      fields.emplace_back();
    } else {
      fields.back() += c;
    }
  }
  if (inside) throw DataError(fmt::format("{}: line {}: a quote is open", name, line.number));
  return fields;
}

Intrinsics CsvIntrinsics(const std::vector<double>& v, const std::string& place) {
  Intrinsics k{PixelCount(v[7], place),  PixelCount(v[8], place), v[9], v[10], v[11], v[12],
               {v.begin() + 13, v.end()}};
  k.Validate(place);
  return k;
}

}  // namespace

std::string RowsOf(const Eigen::MatrixXd& matrix) {
  std::string text;
  for (Eigen::Index r = 0; r < matrix.rows(); ++r) {
    for (Eigen::Index c = 0; c < matrix.cols(); ++c)
      text += fmt::format("{}{}", c > 0 ? " " : "", matrix(r, c));
    text += "\n";
  }
  return text;
}

double ParseNumber(const std::string& word, const std::string& place) {
  const std::optional<double> value = NumberOf(word);
  if (!value) throw DataError(fmt::format("{}: \"{}\" is no number", place, Shortened(word)));
  return *value;
}

std::string DepthComments(const Poses& poses) {
  std::string text;
  for (const SensorPose& pose : poses) {
    if (!pose.corrects_depth()) continue;
    if (text.empty()) text = fmt::format("# {}:\n", kDepthConvention);
    text += fmt::format("# depth_gain {} depth_offset_m {} {}\n", pose.depth_gain,
                        pose.depth_offset_m, pose.name);
  }
  return text;
}

void ReadDepthComments(const std::string& text, const std::string& name, Poses* poses) {
  for (const Line& line : LinesOf(text)) {
    std::istringstream words(line.text);
    std::string hash, gain_key, gain, offset_key, offset, sensor;
    if (!(words >> hash >> gain_key >> gain >> offset_key >> offset) || hash != "#" ||
        gain_key != "depth_gain" || offset_key != "depth_offset_m")
      continue;
    words.get();
    std::getline(words, sensor);
    const std::string place = fmt::format("{}: line {}", name, line.number);
    for (SensorPose& pose : *poses) {
      if (pose.name != sensor) continue;
      pose.depth_gain = ParseNumber(gain, place);
      pose.depth_offset_m = ParseNumber(offset, place);
    }
  }
}

int PixelCount(double value, const std::string& place) {
  if (!(value >= 1 && value <= std::numeric_limits<int>::max() && value == std::floor(value)))
    throw DataError(fmt::format("{}: {} is no number of pixels", place, value));
  return static_cast<int>(value);
}

std::string WriteOpen3dLog(const Poses& poses, const FileFrame& frame) {
  std::string text =
      "# world_from_camera, 4x4, row-major, metres, after a line with three numbers of the "
      "frame.\n# Camera: x right, y down, z forward. World: " +
      frame.world + "\n";
  for (std::size_t i = 0; i < poses.size(); ++i) text += NameLine(i, poses[i].name);
  text += DepthComments(poses);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    text +=
        fmt::format("{0} {0} {1}\n", i, i + 1) + RowsOf(poses[i].structure_from_sensor.matrix());
  }
  return text;
}

Poses ReadOpen3dLog(const std::string& text, const std::string& name) {
  const std::vector<Line> all = LinesOf(text), lines = WithoutComments(all);
  if (lines.size() % 5 != 0)
    throw DataError(fmt::format("{}: {} lines, not five per pose", name, lines.size()));
  Poses poses;
  for (std::size_t l = 0; l < lines.size(); l += 5) {
    Numbers(lines[l], 3, name);
    const Eigen::MatrixXd m = MatrixOf(lines, l + 1, 4, 4, name);
    poses.push_back({NameOf(all, poses.size()),
                     PoseFromRotation(m.topLeftCorner<3, 3>(), m.topRightCorner<3, 1>(),
                                      fmt::format("{}: line {}", name, lines[l].number))});
  }
  ReadDepthComments(text, name, &poses);
  return poses;
}

std::string WriteTum(const Poses& poses, const FileFrame& frame) {
  std::string text =
      "# timestamp tx ty tz qx qy qz qw: world_from_camera, metres. The timestamp is the sensor's "
      "number.\n# Camera: x right, y down, z forward. World: " +
      frame.world + "\n";
  for (std::size_t i = 0; i < poses.size(); ++i) text += NameLine(i, poses[i].name);
  text += DepthComments(poses);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const Pose& pose = poses[i].structure_from_sensor;
    const Eigen::Quaterniond q = QuaternionOf(pose.linear());
    text += fmt::format("{} {} {} {} {} {} {} {}\n", i, pose.translation().x(),
                        pose.translation().y(), pose.translation().z(), q.x(), q.y(), q.z(), q.w());
  }
  return text;
}

Poses ReadTum(const std::string& text, const std::string& name) {
  const std::vector<Line> all = LinesOf(text);
  Poses poses;
  for (const Line& line : WithoutComments(all)) {
    const std::vector<double> v = Numbers(line, 8, name);
    poses.push_back({NameOf(all, poses.size()),
                     PoseFromQuaternion(v[7], v[4], v[5], v[6], {v[1], v[2], v[3]},
                                        fmt::format("{}: line {}", name, line.number))});
  }
  ReadDepthComments(text, name, &poses);
  return poses;
}

std::string WriteCsv(const Poses& poses, const FileFrame& frame) {
  std::string text =
      "# x_m..qw: structure_from_sensor. Sensor: x right, y down, z forward. Structure: " +
      frame.world + ". Pixel centres at integer coordinates. Distortion: OpenCV's order\n" +
      DepthComments(poses) + CsvHeader() + "\n";
  for (const SensorPose& pose : poses) {
    const Eigen::Vector3d& t = pose.structure_from_sensor.translation();
    const Eigen::Quaterniond q = QuaternionOf(pose.structure_from_sensor.linear());
    text += fmt::format("{},{},{},{},{},{},{},{}", CsvQuoted(pose.name), t.x(), t.y(), t.z(), q.x(),
                        q.y(), q.z(), q.w());
    if (pose.intrinsics) {
      const Intrinsics& k = *pose.intrinsics;
      text += fmt::format(",{},{},{},{},{},{}", k.width, k.height, k.fx, k.fy, k.cx, k.cy);
      for (const double d : k.distortion) text += fmt::format(",{}", d);
      text += std::string(static_cast<std::size_t>(kMostDistortion) - k.distortion.size(), ',');
    } else {
      text += std::string(6 + kMostDistortion, ',');
    }
    text += "\n";
  }
  return text;
}

Poses ReadCsv(const std::string& text, const std::string& name) {
  const std::vector<Line> lines = WithoutComments(LinesOf(text));
  if (lines.empty() || lines[0].text != CsvHeader())
    throw DataError(fmt::format("{}: the columns are not {}", name, CsvHeader()));
  Poses poses;
  for (std::size_t l = 1; l < lines.size(); ++l) {
    const std::string place = fmt::format("{}: line {}", name, lines[l].number);
    std::vector<std::string> fields = CsvFields(lines[l], name);
    const std::size_t columns = std::size(kCsvColumns) + kMostDistortion;
    if (fields.size() != columns)
      throw DataError(fmt::format("{}: {} columns instead of {}", place, fields.size(), columns));
    std::string numbers;
    for (std::size_t i = 1; i < fields.size(); ++i) numbers += " " + fields[i];
    while (fields.back().empty()) fields.pop_back();
    const std::vector<double> v = Numbers({lines[l].number, numbers}, fields.size() - 1, name);
    SensorPose pose{CsvText(fields[0]),
                    PoseFromQuaternion(v[6], v[3], v[4], v[5], {v[0], v[1], v[2]}, place)};
    if (v.size() > 7) {
      if (v.size() < 13) throw DataError(place + ": intrinsics with gaps");
      pose.intrinsics = CsvIntrinsics(v, place);
    }
    poses.push_back(std::move(pose));
  }
  ReadDepthComments(text, name, &poses);
  return poses;
}

Files WriteVolumetricCapture(const Poses& poses, const FileFrame& /*frame*/) {
  Files files;
  for (const SensorPose& pose : poses) {
    const Pose& of = pose.structure_from_sensor;
    files[pose.name + kExtension] =
        RowsOf(of.linear()) + RowsOf(1000 * of.translation().transpose());
  }
  return files;
}

Poses ReadVolumetricCapture(const Files& files) {
  Poses poses;
  for (const auto& [file, text] : files) {
    const std::size_t end = file.rfind(kExtension);
    if (end == std::string::npos || end + std::string(kExtension).size() != file.size()) continue;
    const std::vector<Line> lines = LinesOf(text);
    if (lines.size() != 4)
      throw DataError(fmt::format("{}: {} lines instead of 4", file, lines.size()));
    const Eigen::MatrixXd m = MatrixOf(lines, 0, 4, 3, file);
    poses.push_back(
        {file.substr(0, end), PoseFromRotation(m.topRows<3>(), 1e-3 * m.row(3).transpose(), file)});
  }
  if (poses.empty()) throw DataError("the folder has no file NAME.extrinsics");
  return poses;
}

}  // namespace volalign::poses_internal
