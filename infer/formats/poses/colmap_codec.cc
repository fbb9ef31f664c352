// COLMAP's sparse model as text (https://colmap.github.io/format.html): cameras.txt, images.txt,
// points3D.txt.

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <sstream>

#include "core/base/error.h"
#include "core/base/text.h"
#include "infer/formats/poses/codecs.h"

namespace volalign::poses_internal {

namespace {

/// COLMAP's pixel centres are at .5, ours at integer coordinates.
constexpr double kPixelCentre = 0.5;

std::string CameraLine(std::size_t id, const Intrinsics& k) {
  std::vector<double> parameters = {k.fx, k.fy, k.cx + kPixelCentre, k.cy + kPixelCentre};
  const char* model = "PINHOLE";
  if (!k.distortion.empty()) {
    // Both have OpenCV's order; the full model needs all eight.
    model = k.distortion.size() == 4 ? "OPENCV" : "FULL_OPENCV";
    std::vector<double> lens = k.distortion;
    lens.resize(lens.size() == 4 ? 4 : 8);
    parameters.insert(parameters.end(), lens.begin(), lens.end());
  }
  return fmt::format("{} {} {} {} {}\n", id, model, k.width, k.height, fmt::join(parameters, " "));
}

/// The words of the lines that are not empty.
std::vector<std::vector<std::string>> Table(const std::string& text) {
  std::vector<std::vector<std::string>> table;
  std::istringstream stream(text);
  std::string line, word;
  while (std::getline(stream, line)) {
    if (!line.empty() && line[0] == '#') continue;
    std::istringstream words(line);
    table.emplace_back();
    while (words >> word) table.back().push_back(word);
  }
  return table;
}

Intrinsics CameraOf(const std::vector<std::string>& words) {
  const std::string place = fmt::format("cameras.txt: camera {}", Shortened(words[0]));
  const std::size_t parameters = words[1] == "PINHOLE"       ? 4
                                 : words[1] == "OPENCV"      ? 8
                                 : words[1] == "FULL_OPENCV" ? 12
                                                             : 0;
  if (parameters == 0)
    throw DataError(fmt::format("{}: model {}; known are PINHOLE, OPENCV and FULL_OPENCV", place,
                                Shortened(words[1])));
  if (words.size() != 4 + parameters)
    throw DataError(
        fmt::format("{}: {} parameters instead of {}", place, words.size() - 4, parameters));
  std::vector<double> v;
  for (std::size_t i = 2; i < words.size(); ++i) v.push_back(ParseNumber(words[i], place));
  Intrinsics k{PixelCount(v[0], place), PixelCount(v[1], place), v[2], v[3], v[4] - kPixelCentre,
               v[5] - kPixelCentre,     {v.begin() + 6, v.end()}};
  k.Validate(place);
  return k;
}

const std::string& FileOf(const Files& files, const char* name) {
  const auto file = files.find(name);
  if (file == files.end()) throw DataError(fmt::format("the folder has no {}", name));
  return file->second;
}

}  // namespace

Files WriteColmap(const Poses& poses, const FileFrame& frame) {
  std::string cameras =
      "# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[] (fx fy cx cy, then k1 k2 p1 p2 k3 k4 k5 k6; the "
      "upper left pixel's centre is at 0.5, 0.5)\n";
  std::string images =
      "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME (camera_from_world, metres. Camera: x right, "
      "y down, z forward. World: " +
      frame.world + "), then a line of points: none\n" + DepthComments(poses);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (poses[i].name.find_first_of(" \t\n") != std::string::npos)
      throw ConfigError(fmt::format("COLMAP's names have no blanks: \"{}\"", poses[i].name));
    const Pose pose = poses[i].structure_from_sensor.inverse();
    const Eigen::Quaterniond q = QuaternionOf(pose.linear());
    const Eigen::Vector3d& t = pose.translation();
    cameras += CameraLine(i + 1, *poses[i].intrinsics);
    images += fmt::format("{0} {1} {2} {3} {4} {5} {6} {7} {0} {8}\n\n", i + 1, q.w(), q.x(), q.y(),
                          q.z(), t.x(), t.y(), t.z(), poses[i].name);
  }
  return {{"cameras.txt", cameras},
          {"images.txt", images},
          {"points3D.txt", "# POINT3D_ID X Y Z R G B ERROR TRACK[]: none\n"}};
}

Poses ReadColmap(const Files& files) {
  std::map<std::string, Intrinsics> cameras;
  for (const auto& words : Table(FileOf(files, "cameras.txt"))) {
    if (words.size() > 4) cameras[words[0]] = CameraOf(words);
  }
  Poses poses;
  // The second of the two lines of an image may be empty.
  const auto table = Table(FileOf(files, "images.txt"));
  for (std::size_t l = 0; l < table.size(); l += 2) {
    const std::vector<std::string>& words = table[l];
    if (words.empty()) break;  // at the end
    const std::string place = fmt::format("images.txt: image {}", Shortened(words[0]));
    if (words.size() != 10)
      throw DataError(fmt::format("{}: {} words instead of 10", place, words.size()));
    std::vector<double> v;
    for (std::size_t i = 1; i < 8; ++i) v.push_back(ParseNumber(words[i], place));
    const auto camera = cameras.find(words[8]);
    if (camera == cameras.end())
      throw DataError(fmt::format("{}: there is no camera {}", place, Shortened(words[8])));
    poses.push_back(
        {words[9], PoseFromQuaternion(v[0], v[1], v[2], v[3], {v[4], v[5], v[6]}, place).inverse(),
         camera->second});
  }
  ReadDepthComments(FileOf(files, "images.txt"), "images.txt", &poses);
  return poses;
}

}  // namespace volalign::poses_internal
