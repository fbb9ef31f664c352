#include "infer/io/export.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <iterator>
#include <map>
#include <thread>

#include "core/file_util.h"
#include "core/image_io.h"
#include "core/parallel_for.h"
#include "core/picture.h"
#include "core/visibility.h"
#include "infer/view/sensor_view.h"

namespace volalign {

namespace {

/// Appends a value's bytes, little-endian first.
template <class T>
void Append(std::string* bytes, T value) {
  std::array<char, sizeof(T)> raw;
  std::memcpy(raw.data(), &value, sizeof(T));
#if __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__
  std::reverse(raw.begin(), raw.end());
#endif
  bytes->append(raw.data(), raw.size());
}

LabelImage ConfidenceImage(const Image<float>& confidence) {
  LabelImage image(confidence.width(), confidence.height());
  std::transform(confidence.begin(), confidence.end(), image.begin(), [](float c) {
    return static_cast<std::uint8_t>(std::lround(255 * std::clamp(c, 0.0f, 1.0f)));
  });
  return image;
}

/// Range of depths to colour: where the middle 96 % of the pixels lie.
std::pair<double, double> DepthRange(const DepthImage& depth) {
  std::vector<float> values;
  std::copy_if(depth.begin(), depth.end(), std::back_inserter(values),
               [](float z) { return z > 0; });
  if (values.empty()) return {0.5, 5.0};
  std::sort(values.begin(), values.end());
  const std::size_t last = values.size() - 1;
  const double low = values[last / 50], high = values[last - last / 50];
  return {low, std::max(high, low + 0.1)};
}

}  // namespace

std::vector<ExportPoint> AlignedPoints(const SensorFrame& frame, const SensorResult& result,
                                       const Structure& structure, double max_radius) {
  std::vector<ExportPoint> points;
  if (!result.structure_from_sensor) return points;
  const SensorView view = Corrected(MakeSensorView(frame.depth, frame.intrinsics),
                                    result.depth_gain, result.depth_offset_m);
  constexpr Rgb kBackground{150, 150, 150};
  for (int v = 0; v < view.height(); ++v) {
    for (int u = 0; u < view.width(); ++u) {
      if (!(view.depth(u, v) > 0)) continue;
      const Eigen::Vector3d p = *result.structure_from_sensor * view.Point(u, v);
      if (std::hypot(p.x(), p.z()) > max_radius) continue;
      ExportPoint point;
      point.x = static_cast<float>(p.x());
      point.y = static_cast<float>(p.y());
      point.z = static_cast<float>(p.z());
      point.label = result.segmentation.labels(u, v);
      point.confidence = result.segmentation.confidence(u, v);
      const bool side = point.label > 0 && point.label < structure.num_classes();
      point.colour = side ? LabelColour(point.label) : kBackground;
      point.residual =
          static_cast<float>(side ? (structure.SideOfLabel(point.label).ClosestPoint(p) - p).norm()
                                  : DistanceToSurface(structure, p).distance);
      points.push_back(point);
    }
  }
  return points;
}

void WritePly(const std::filesystem::path& path, const std::vector<ExportPoint>& points) {
  std::string bytes = fmt::format(
      "ply\nformat binary_little_endian 1.0\n"
      "comment volalign: structure frame, metres, y up; residual: distance to the labelled side\n"
      "element vertex {}\n"
      "property float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\n"
      "property uchar label\nproperty float confidence\nproperty float residual\nend_header\n",
      points.size());
  constexpr std::size_t kBytesAPoint = 24;
  bytes.reserve(bytes.size() + kBytesAPoint * points.size());
  for (const ExportPoint& point : points) {
    Append(&bytes, point.x);
    Append(&bytes, point.y);
    Append(&bytes, point.z);
    Append(&bytes, point.colour.r);
    Append(&bytes, point.colour.g);
    Append(&bytes, point.colour.b);
    Append(&bytes, point.label);
    Append(&bytes, point.confidence);
    Append(&bytes, point.residual);
  }
  WriteFileAtomically(path, bytes);
}

RgbImage SensorPicture(const SensorFrame& frame, const SensorResult& result,
                       const Structure& structure, int turns) {
  const SensorView view = MakeSensorView(frame.depth, frame.intrinsics);
  const auto [near, far] = DepthRange(view.depth);
  std::vector<RgbImage> panels;
  panels.push_back(Turn(ColourDepth(view.depth, near, far), turns));
  panels.push_back(Turn(OverlayLabels(view.depth, result.segmentation.labels), turns));
  if (result.structure_from_sensor) {
    const StructureView model = CastView(structure, view.rays, *result.structure_from_sensor);
    panels.push_back(Turn(OverlayLabels(view.depth, model.labels), turns));
  }
  return Montage(panels, 3);
}

namespace {

/// Overlap of each two sensors in percent above the diagonal, RMS between them in mm below it.
std::string OverlapTable(const CalibrationResult& result) {
  constexpr std::size_t kWidest = 16;  // sensors
  if (result.pairs.empty()) return "";
  double worst = 0;
  for (const PairResult& pair : result.pairs) worst = std::max(worst, pair.rms_m);
  const std::string summary =
      fmt::format("{} overlapping pair{}, at most {:.1f} mm RMS apart\n", result.pairs.size(),
                  result.pairs.size() == 1 ? "" : "s", 1000 * worst);
  std::vector<std::string> names;
  std::size_t width = 5;
  for (const SensorResult& sensor : result.sensors) {
    if (!sensor.structure_from_sensor) continue;
    names.push_back(sensor.name);
    width = std::max(width, sensor.name.size());
  }
  if (names.size() > kWidest) return summary;
  std::string text = fmt::format("{:<{}}", "", width);
  for (const std::string& name : names) text += fmt::format("  {:>{}}", name, width);
  text += "   overlap, % above the diagonal; RMS, mm below\n";
  for (std::size_t i = 0; i < names.size(); ++i) {
    text += fmt::format("{:<{}}", names[i], width);
    for (std::size_t j = 0; j < names.size(); ++j) {
      std::string cell = i == j ? "." : "-";
      for (const PairResult& pair : result.pairs) {
        const bool this_way = pair.a == names[i] && pair.b == names[j];
        if (!this_way && !(pair.a == names[j] && pair.b == names[i])) continue;
        cell = i < j ? fmt::format("{:.0f}", 100 * pair.overlap)
                     : fmt::format("{:.1f}", 1000 * pair.rms_m);
      }
      text += fmt::format("  {:>{}}", cell, width);
    }
    text += '\n';
  }
  return text + summary;
}

}  // namespace

std::string FormatReport(const CalibrationResult& result) {
  std::size_t width = 6;
  bool truth = false;
  for (const SensorResult& sensor : result.sensors) {
    width = std::max(width, sensor.name.size());
    truth = truth || sensor.error.has_value();
  }
  std::string text =
      fmt::format("{:<{}}  {:<6}  {:>5}  {:>7}  {:>8}  {:>8}  {:>7}  {:>9}", "sensor", width,
                  "status", "sides", "rms mm", "sigma mm", "sigma deg", "inliers", "refined");
  if (truth) text += fmt::format("  {:>8}  {:>9}", "error mm", "error deg");
  text += '\n';
  for (const SensorResult& sensor : result.sensors) {
    if (!sensor.structure_from_sensor) {
      text += fmt::format("{:<{}}  {:<6}\n", sensor.name, width, ToString(sensor.status));
      continue;
    }
    text += fmt::format(
        "{:<{}}  {:<6}  {:>5}  {:>7.1f}  {:>8.2f}  {:>9.3f}  {:>5.0f} %  {:>9}", sensor.name, width,
        ToString(sensor.status), sensor.sides.size(), 1000 * sensor.rms_to_structure_m,
        1000 * sensor.sigma_translation_m().maxCoeff(), sensor.sigma_rotation_deg().maxCoeff(),
        100 * sensor.inlier_share, sensor.refinement_accepted ? "yes" : "no");
    if (sensor.error) {
      text += fmt::format("  {:>8.2f}  {:>9.3f}", 1000 * sensor.error->translation_m,
                          sensor.error->rotation_deg);
    }
    text += '\n';
  }
  for (const SensorResult& sensor : result.sensors) {
    if (sensor.status == SensorStatus::kOk) continue;
    text += fmt::format("{} is {} ({}): {}; {}\n", sensor.name, ToString(sensor.status),
                        ToString(sensor.code), sensor.reason, sensor.hint);
  }
  for (const SensorResult& sensor : result.sensors) {
    if (!sensor.structure_from_sensor) continue;
    for (const std::string& direction : UnconstrainedDirections(sensor.covariance))
      text += fmt::format("{} is hardly constrained {}\n", sensor.name, direction);
  }
  for (std::size_t b = 0; b < result.boxes.size(); ++b) {
    const RefinedBox& box = result.boxes[b];
    if (!box.estimated) continue;
    text += fmt::format(
        "box {} stands {:+.1f} mm along x, {:+.1f} mm along z, turned by {:+.2f} deg "
        "(sigma {:.1f}, {:.1f} mm, {:.2f} deg)\n",
        result.built.boxes()[b].name, 1000 * box.x, 1000 * box.z, box.yaw * 180 / M_PI,
        1000 * box.sigma_x, 1000 * box.sigma_z, box.sigma_yaw * 180 / M_PI);
  }
  if (result.size_estimated) {
    text += fmt::format("boxes are {:.2f} % of their nominal size (sigma {:.2f} %)\n",
                        100 * result.size_scale, 100 * result.sigma_size_scale);
  }
  text += OverlapTable(result);
  if (result.metrics) {
    text += fmt::format("d1 {:.1f} mm, d2 {:.1f} mm\n", 1000 * result.metrics->d1,
                        1000 * result.metrics->d2);
  }
  if (!result.timings_s.empty()) {
    text += "seconds:";
    for (const auto& [stage, seconds] : result.timings_s)
      text += fmt::format(" {} {:.2f}{}", stage, seconds,
                          &stage == &result.timings_s.back().first ? "\n" : ",");
  }
  text += fmt::format("{} of {} sensors placed; verdict: {}", result.placed(),
                      result.sensors.size(), ToString(result.verdict()));
  if (result.assembly && result.assembly->altered())
    text += fmt::format(": {}", result.assembly->arrangement.sentence);
  text += '\n';
  return text;
}

void WriteCalibration(const std::filesystem::path& folder, const CalibrationResult& result,
                      const std::vector<SensorFrame>& frames, const Structure& structure,
                      const ExtrinsicsSource& source) {
  // A sensor without a pose is shown as most of the others are mounted.
  std::map<int, int> mounted;
  for (const SensorResult& sensor : result.sensors) {
    if (sensor.structure_from_sensor) ++mounted[UprightTurns(*sensor.structure_from_sensor)];
  }
  int usual = 0, most = 0;
  for (const auto& [turns, count] : mounted) {
    if (count > most) {
      usual = turns;
      most = count;
    }
  }
  const Structure& built = result.built.boxes().empty() ? structure : result.built;
  std::vector<RgbImage> overview(result.sensors.size());
  std::vector<std::vector<ExportPoint>> clouds(result.sensors.size());
  const int threads = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  ParallelFor(result.sensors.size(), threads, [&](std::size_t i) {
    const SensorResult& sensor = result.sensors[i];
    const std::string png = sensor.name + ".png";
    WritePng(folder / "labels" / png, sensor.segmentation.labels);
    WritePng(folder / "confidence" / png, ConfidenceImage(sensor.segmentation.confidence));
    const int turns =
        sensor.structure_from_sensor ? UprightTurns(*sensor.structure_from_sensor) : usual;
    overview[i] = SensorPicture(frames.at(i), sensor, built, turns);
    WritePng(folder / "pictures" / png, overview[i]);
    if (!sensor.structure_from_sensor) return;
    clouds[i] = AlignedPoints(frames.at(i), sensor, built);
    WritePly(folder / "clouds" / (sensor.name + ".ply"), clouds[i]);
  });
  std::vector<ExportPoint> merged;
  for (const std::vector<ExportPoint>& cloud : clouds)
    merged.insert(merged.end(), cloud.begin(), cloud.end());
  WritePng(folder / "pictures" / "overview.png", Montage(overview, overview.size() > 3 ? 2 : 1));
  WritePly(folder / "clouds" / "merged.ply", merged);
  WriteExtrinsics(folder / "extrinsics.json", MakeExtrinsics(result, frames, structure, source));
}

}  // namespace volalign
