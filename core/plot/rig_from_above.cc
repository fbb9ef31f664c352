#include "core/plot/rig_from_above.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <vector>

#include "core/geometry/lens.h"
#include "core/plot/svg.h"

namespace volalign {

namespace {

constexpr double kPixelsAMetre = 120;
constexpr double kBeside = 1.3, kAbove = 0.6;  // m around all ellipses: room for their names
constexpr double kMagnification = 20;          // of the errors' ellipses
constexpr double kSigmas = 2;                  // their half axes
constexpr double kBeyondStack = 0.5;           // m
constexpr double kLegendHeight = 92;           // px
constexpr double kFacesUp = 0.1;               // y of a normal: narrower strips are not drawn

/// Structure frame, seen from above, to px: x to the right, z downwards.
class Paper {
 public:
  explicit Paper(const std::vector<SensorFromAbove>& sensors) {
    for (const SensorFromAbove& sensor : sensors) {
      const Eigen::Vector3d& at = sensor.structure_from_sensor.translation();
      const double error = kSigmas * kMagnification * std::sqrt(sensor.covariance.trace());
      const Eigen::Vector2d place(at.x(), at.z()), margin(kBeside + error, kAbove + error);
      low_ = low_.cwiseMin(place - margin);
      high_ = high_.cwiseMax(place + margin);
    }
  }
  double width() const { return (high_ - low_).x() * kPixelsAMetre; }
  double height() const { return (high_ - low_).y() * kPixelsAMetre; }
  Svg::Point At(const Eigen::Vector3d& p) const {
    return {(p.x() - low_.x()) * kPixelsAMetre, (p.z() - low_.y()) * kPixelsAMetre};
  }

 private:
  Eigen::Vector2d low_{-1, -1}, high_{1, 1};  // m, x and z of the corners
};

/// Draws the sensor's view of the horizontal plane through itself, up to behind the stack.
void DrawView(const SensorFromAbove& sensor, const Paper& paper, Svg* svg) {
  const Pose& pose = sensor.structure_from_sensor;
  const Eigen::Vector3d eye = pose.translation();
  const Eigen::Vector3d forward = pose.linear().col(2);
  double left = 0, right = 0;  // angles from the optical axis, seen from above
  const RayTable rays = ComputeRays(sensor.intrinsics);
  const double heading = std::atan2(forward.z(), forward.x());
  for (int v = 0; v < rays.height; v += std::max(1, rays.height / 16)) {
    for (int u = 0; u < rays.width; ++u) {
      if (u > 0 && u + 1 < rays.width && v > 0 && v + 1 < rays.height) continue;
      const Eigen::Vector2f& ray = rays.at(u, v);
      if (!ray.allFinite()) continue;
      const Eigen::Vector3d to = pose.linear() * Eigen::Vector3d(ray.x(), ray.y(), 1);
      const double angle = std::remainder(std::atan2(to.z(), to.x()) - heading, 2 * M_PI);
      // Rays far below or above the horizon have large angles without seeing more of the stack.
      if (std::abs(to.y()) > 0.7 * to.norm()) continue;
      left = std::min(left, angle);
      right = std::max(right, angle);
    }
  }
  const double reach = Eigen::Vector2d(eye.x(), eye.z()).norm() + kBeyondStack;
  std::vector<Svg::Point> points{paper.At(eye)};
  constexpr int kSteps = 12;
  for (int i = 0; i <= kSteps; ++i) {
    const double angle = heading + left + (right - left) * i / kSteps;
    points.push_back(paper.At(eye + reach * Eigen::Vector3d(std::cos(angle), 0, std::sin(angle))));
  }
  svg->Polygon(points, fmt::format("class=\"rig-view\" fill=\"{}\"", sensor.colour));
}

/// Uncertainty of a sensor's place on the floor plan, px: half axes and the direction of the larger
/// one.
struct Ellipse {
  double major = 0, minor = 0, deg = 0;
};

Ellipse ErrorEllipse(const SensorFromAbove& sensor) {
  const Eigen::Matrix3d& position = sensor.covariance;
  Eigen::Matrix2d flat;
  flat << position(0, 0), position(0, 2), position(2, 0), position(2, 2);
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> solver(flat);
  const auto half = [&](int i) {
    return std::sqrt(std::max(solver.eigenvalues()[i], 0.0)) * kSigmas * kMagnification *
           kPixelsAMetre;
  };
  const Eigen::Vector2d major = solver.eigenvectors().col(1);
  return {half(1), half(0), std::atan2(major.y(), major.x()) * 180 / M_PI};
}

void DrawSensor(const SensorFromAbove& sensor, const Paper& paper, Svg* svg) {
  const Eigen::Vector3d& eye = sensor.structure_from_sensor.translation();
  const Eigen::Vector3d forward = sensor.structure_from_sensor.linear().col(2);
  const auto [x, y] = paper.At(eye);
  const Ellipse ellipse = ErrorEllipse(sensor);
  const auto moved = [x = x, y = y](double deg) {
    return fmt::format("transform=\"translate({:.1f} {:.1f}) rotate({:.1f})\"", x, y, deg);
  };
  svg->Element("ellipse", fmt::format("class=\"rig-error\" rx=\"{:.1f}\" ry=\"{:.1f}\" {}",
                                      ellipse.major, ellipse.minor, moved(ellipse.deg)));
  svg->Polygon({{9, 0}, {-7, -7}, {-7, 7}},
               fmt::format("fill=\"{}\" {}", sensor.colour,
                           moved(std::atan2(forward.z(), forward.x()) * 180 / M_PI)),
               sensor.title);
  // Names stand on the side away from the stack.
  const Eigen::Vector2d away = Eigen::Vector2d(eye.x(), eye.z()).normalized();
  const std::string anchor = fmt::format(
      "text-anchor=\"{}\"", away.x() > 0.3 ? "start" : (away.x() < -0.3 ? "end" : "middle"));
  const double beside = ellipse.major + 14;
  const double text_x = x + beside * away.x();
  const double text_y = y + (beside + 6) * away.y() - (away.y() < 0 ? 8 : 0);
  svg->Text({text_x, text_y}, sensor.name, anchor + " font-weight=\"bold\"");
  svg->Text({text_x, text_y + 16}, sensor.note, anchor);
}

void DrawLegend(const Paper& paper, const LegendFromAbove& legend, bool has_ellipses, Svg* svg) {
  const double top = paper.height() + 24;
  svg->Polyline(
      {{20, top}, {20, top - 6}, {20 + kPixelsAMetre, top - 6}, {20 + kPixelsAMetre, top}},
      "class=\"rig-axis\"");
  svg->Text({26, top - 10}, "1 m");
  double x = 40 + kPixelsAMetre;
  for (const auto& [colour, word] : legend.colours) {
    svg->Circle({x, top - 4}, 6, fmt::format("fill=\"{}\"", colour));
    svg->Text({x + 11, top}, word);
    x += 35 + 8 * static_cast<double>(word.size());
  }
  svg->Text({20, top + 26}, legend.line);
  if (!has_ellipses) return;
  svg->Text({20, top + 44},
            fmt::format("ellipses: {:.0f} standard deviations, {:.0f} times enlarged", kSigmas,
                        kMagnification));
}

/// Draws a part from above: the upper side of a box, or the triangles of a mesh that face up, and
/// their borders.
void DrawPart(const Box& part, const Paper& paper, Svg* svg) {
  const auto place = [&](const Eigen::Vector3d& p) {
    return paper.At(part.structure_from_box * p);
  };
  if (!part.mesh) {
    const Eigen::Vector3d half = part.size / 2;
    std::vector<Svg::Point> corners;
    for (const auto& [x, z] : {std::pair(-1, -1), {1, -1}, {1, 1}, {-1, 1}})
      corners.push_back(place({x * half.x(), half.y(), z * half.z()}));
    return svg->Polygon(corners, "class=\"rig-box\"", part.name);
  }
  // One path each: surfaces one above another are not darker.
  std::string surface, borders;
  const auto add = [&](char command, const Eigen::Vector3d& p, std::string* path) {
    const Svg::Point q = place(part.MeshScale() * p);
    *path += fmt::format("{}{:.1f} {:.1f}", command, q.x, q.y);
  };
  const auto faces_up = [&](const Eigen::Vector3d& normal) {
    return part.structure_from_box.linear().row(1).dot(normal) > kFacesUp;
  };
  for (std::size_t i = 0; i < part.mesh->triangles().size(); ++i) {
    if (!faces_up(part.mesh->NormalOf(static_cast<int>(i)))) continue;
    char command = 'M';
    for (const int vertex : part.mesh->triangles()[i]) {
      add(command, part.mesh->vertices()[static_cast<std::size_t>(vertex)], &surface);
      command = 'L';
    }
    surface += "Z";
  }
  for (const Facet& facet : part.mesh->facets()) {
    if (!faces_up(facet.normal)) continue;
    for (const Outline::Border& border : facet.outline->borders) {
      const auto end = [&](const Eigen::Vector2d& p) {
        return Eigen::Vector3d(facet.centre + p.x() * facet.axis_u + p.y() * facet.axis_v);
      };
      add('M', end(border.from), &borders);
      add('L', end(border.to), &borders);
    }
  }
  svg->Element("path", fmt::format("class=\"rig-box\" style=\"stroke:none\" d=\"{}\"", surface));
  svg->Element("path", fmt::format("class=\"rig-box\" style=\"fill:none\" d=\"{}\"", borders));
}

/// The structure's axes.
void DrawAxes(const Paper& paper, Svg* svg) {
  constexpr double kLength = 0.5 * kPixelsAMetre;
  const auto [x, y] = paper.At(Eigen::Vector3d(Eigen::Vector3d::Zero()));
  svg->Polyline({{x + kLength, y}, {x, y}, {x, y + kLength}}, "class=\"rig-axis\"");
  svg->Text({x + kLength + 4, y + 4}, "x, front");
  svg->Text({x - 4, y + kLength + 16}, "z, right");
}

}  // namespace

std::string RigFromAbove(const Structure& structure, const std::vector<SensorFromAbove>& sensors,
                         const LegendFromAbove& legend) {
  const Paper paper(sensors);
  const double width = std::max(paper.width(), 640.0);
  Svg svg(width, paper.height() + kLegendHeight,
          ".rig-view{fill-opacity:.08}.rig-box{fill:#999;fill-opacity:.35;stroke:#444}"
          ".rig-error{fill:none;stroke:#222;stroke-dasharray:3 2}"
          ".rig-axis{fill:none;stroke:#222;stroke-width:1.5}",
          (paper.width() - width) / 2);
  for (const SensorFromAbove& sensor : sensors) DrawView(sensor, paper, &svg);
  for (const Box& part : structure.boxes()) DrawPart(part, paper, &svg);
  DrawAxes(paper, &svg);
  for (const SensorFromAbove& sensor : sensors) DrawSensor(sensor, paper, &svg);
  const bool has_ellipses =
      std::any_of(sensors.begin(), sensors.end(),
                  [](const SensorFromAbove& sensor) { return !sensor.covariance.isZero(); });
  DrawLegend(paper, legend, has_ellipses, &svg);
  return svg.Finished();
}

}  // namespace volalign
