#include "infer/io/plan_picture.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <vector>

#include "core/lens.h"

namespace volalign {

namespace {

constexpr double kPixelsAMetre = 120;
constexpr double kMargin = 1.3;        // m around all sensors: room for their names
constexpr double kMagnification = 20;  // of the errors' ellipses
constexpr double kSigmas = 2;          // their half axes
constexpr double kBeyondStack = 0.5;   // m
constexpr double kLegendHeight = 92;   // px
// Okabe and Ito's colours, which people with any colour vision tell apart.
constexpr char kOk[] = "#0072b2", kWeak[] = "#e69f00", kFailed[] = "#d55e00";

const char* Colour(SensorStatus status) {
  if (status == SensorStatus::kFailed) return kFailed;
  return status == SensorStatus::kWeak ? kWeak : kOk;
}

/// Structure frame, seen from above, to px: x to the right, z downwards.
class Paper {
 public:
  explicit Paper(const RigPlan& plan) {
    for (const PlannedSensor& sensor : plan.sensors) {
      const Eigen::Vector3d& at = sensor.structure_from_sensor.translation();
      reach_ = std::max({reach_, std::abs(at.x()) + kMargin, std::abs(at.z()) + kMargin});
    }
  }
  double size() const { return 2 * reach_ * kPixelsAMetre; }
  double X(const Eigen::Vector3d& p) const { return (p.x() + reach_) * kPixelsAMetre; }
  double Y(const Eigen::Vector3d& p) const { return (p.z() + reach_) * kPixelsAMetre; }
  std::string Points(const std::vector<Eigen::Vector3d>& points) const {
    std::string text;
    for (const Eigen::Vector3d& p : points) text += fmt::format("{:.1f},{:.1f} ", X(p), Y(p));
    return text;
  }

 private:
  double reach_ = 1;
};

std::string Stack(const Structure& structure, const Paper& paper) {
  std::string text;
  for (const Box& box : structure.boxes()) {
    std::vector<Eigen::Vector3d> corners;
    for (const auto& [x, z] : {std::pair{-0.5, -0.5}, {0.5, -0.5}, {0.5, 0.5}, {-0.5, 0.5}}) {
      corners.push_back(box.structure_from_box *
                        Eigen::Vector3d(x * box.size.x(), 0.5 * box.size.y(), z * box.size.z()));
    }
    text += fmt::format("<polygon class=\"box\" points=\"{}\"><title>{}</title></polygon>\n",
                        paper.Points(corners), box.name);
  }
  return text;
}

/// What the sensor sees on the horizontal plane through itself, up to behind the stack.
std::string View(const PlannedSensor& sensor, const Paper& paper) {
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
      // Rays far below or above the horizon turn far aside without seeing more of the stack.
      if (std::abs(to.y()) > 0.7 * to.norm()) continue;
      left = std::min(left, angle);
      right = std::max(right, angle);
    }
  }
  const double reach = Eigen::Vector2d(eye.x(), eye.z()).norm() + kBeyondStack;
  std::vector<Eigen::Vector3d> points{eye};
  constexpr int kSteps = 12;
  for (int i = 0; i <= kSteps; ++i) {
    const double angle = heading + left + (right - left) * i / kSteps;
    points.emplace_back(eye + reach * Eigen::Vector3d(std::cos(angle), 0, std::sin(angle)));
  }
  return fmt::format("<polygon class=\"view\" fill=\"{}\" points=\"{}\"/>\n", Colour(sensor.status),
                     paper.Points(points));
}

/// Of a sensor's place on the floor plan, px: half axes and the direction of the larger one.
struct Ellipse {
  double major = 0, minor = 0, deg = 0;
};

Ellipse ErrorEllipse(const PlannedSensor& sensor) {
  const Eigen::Matrix3d position = sensor.PositionCovariance();
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

std::string Draw(const Ellipse& ellipse, double x, double y) {
  return fmt::format(
      "<ellipse class=\"error\" rx=\"{:.1f}\" ry=\"{:.1f}\" transform=\"translate({:.1f} {:.1f}) "
      "rotate({:.1f})\"/>\n",
      ellipse.major, ellipse.minor, x, y, ellipse.deg);
}

std::string Sensor(const PlannedSensor& sensor, const Paper& paper) {
  const Eigen::Vector3d& eye = sensor.structure_from_sensor.translation();
  const Eigen::Vector3d forward = sensor.structure_from_sensor.linear().col(2);
  const double x = paper.X(eye), y = paper.Y(eye);
  const Ellipse ellipse = ErrorEllipse(sensor);
  // Names stand on the side away from the stack.
  const Eigen::Vector2d away = Eigen::Vector2d(eye.x(), eye.z()).normalized();
  const char* anchor = away.x() > 0.3 ? "start" : (away.x() < -0.3 ? "end" : "middle");
  const double beside = ellipse.major + 14;
  const double text_x = x + beside * away.x();
  const double text_y = y + (beside + 6) * away.y() - (away.y() < 0 ? 8 : 0);
  const std::string error =
      sensor.placed > 0
          ? fmt::format("{:.1f} mm, {:.2f}°", 1000 * sensor.expected_m, sensor.expected_deg)
          : "not placed";
  return Draw(ellipse, x, y) +
         fmt::format(
             "<path d=\"M9,0 L-7,-7 L-7,7 Z\" fill=\"{}\" transform=\"translate({:.1f} {:.1f}) "
             "rotate({:.1f})\"/>\n",
             Colour(sensor.status), x, y, std::atan2(forward.z(), forward.x()) * 180 / M_PI) +
         fmt::format(
             "<text class=\"name\" text-anchor=\"{}\" x=\"{:.1f}\" y=\"{:.1f}\">{}</text>\n"
             "<text text-anchor=\"{}\" x=\"{:.1f}\" y=\"{:.1f}\">{}</text>\n",
             anchor, text_x, text_y, sensor.name, anchor, text_x, text_y + 16, error);
}

std::string Axes(const Paper& paper) {
  const Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  const double x = paper.X(origin), y = paper.Y(origin), length = 0.5 * kPixelsAMetre;
  return fmt::format(
      "<path class=\"axis\" d=\"M{0:.1f},{1:.1f} h{2:.1f} M{0:.1f},{1:.1f} v{2:.1f}\"/>\n"
      "<text x=\"{3:.1f}\" y=\"{4:.1f}\">x</text><text x=\"{5:.1f}\" y=\"{6:.1f}\">z</text>\n",
      x, y, length, x + length + 4, y + 4, x - 4, y + length + 16);
}

std::string Legend(const Paper& paper) {
  const double top = paper.size() + 24;
  std::string text = fmt::format(
      "<path class=\"scale\" d=\"M20,{0:.1f} v-6 h{1:.1f} v6\"/><text x=\"26\" "
      "y=\"{2:.1f}\">1 m</text>\n",
      top, kPixelsAMetre, top - 10);
  double x = 40 + kPixelsAMetre;
  for (const auto& [colour, word] :
       {std::pair{kOk, "ok"}, std::pair{kWeak, "weak"}, std::pair{kFailed, "failed"}}) {
    text += fmt::format(
        "<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"6\" fill=\"{}\"/><text x=\"{:.1f}\" "
        "y=\"{:.1f}\">{}</text>\n",
        x, top - 4, colour, x + 11, top, word);
    x += 75;
  }
  return text + fmt::format(
                    "<text x=\"20\" y=\"{:.1f}\">from above, structure frame; by each name its "
                    "expected error</text>\n<text x=\"20\" y=\"{:.1f}\">ellipses: {:.0f} standard "
                    "deviations, {:.0f} times enlarged</text>\n",
                    top + 26, top + 44, kSigmas, kMagnification);
}

}  // namespace

std::string PlanPicture(const RigPlan& plan) {
  const Paper paper(plan);
  const double width = std::max(paper.size(), 640.0);
  std::string text = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0:.0f}\" height=\"{1:.0f}\" "
      "viewBox=\"{2:.0f} 0 {0:.0f} {1:.0f}\">\n"
      "<style>text{{font:13px sans-serif;fill:#222}}.name{{font-weight:bold}}"
      ".view{{fill-opacity:.08;stroke:none}}.box{{fill:#999;fill-opacity:.35;stroke:#444}}"
      ".error{{fill:none;stroke:#222;stroke-dasharray:3 2}}"
      ".axis,.scale{{fill:none;stroke:#222;stroke-width:1.5}}</style>\n"
      "<rect x=\"{2:.0f}\" width=\"{0:.0f}\" height=\"{1:.0f}\" fill=\"#fff\"/>\n",
      width, paper.size() + kLegendHeight, (paper.size() - width) / 2);
  for (const PlannedSensor& sensor : plan.sensors) text += View(sensor, paper);
  text += Stack(plan.structure, paper) + Axes(paper);
  for (const PlannedSensor& sensor : plan.sensors) text += Sensor(sensor, paper);
  return text + Legend(paper) + "</svg>\n";
}

}  // namespace volalign
