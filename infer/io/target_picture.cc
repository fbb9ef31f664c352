#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "infer/io/target_report.h"

namespace volalign {

namespace {

constexpr double kCellWidth = 16, kCellHeight = 34;       // px
constexpr double kLeft = 70, kTop = 60;                   // px, of the cells
constexpr double kBestSigma = 0.001, kWorstSigma = 0.02;  // m, ends of the colour scale
constexpr double kPlanSize = 240;                         // px

/// From yellow (well known) to dark blue, evenly in lightness (ends of the cividis scale, which
/// people with any colour vision can read).
std::string Colour(double sigma_m) {
  const double t =
      std::clamp(std::log(sigma_m / kBestSigma) / std::log(kWorstSigma / kBestSigma), 0.0, 1.0);
  const auto mix = [t](int from, int to) { return static_cast<int>(from + t * (to - from)); };
  return fmt::format("#{:02x}{:02x}{:02x}", mix(0xfd, 0x00), mix(0xe7, 0x22), mix(0x37, 0x4e));
}

std::string Cells(const TargetQuality& quality) {
  std::string text;
  const auto directions = static_cast<std::size_t>(quality.options.directions);
  const std::size_t rows = quality.options.heights_m.size();
  for (std::size_t i = 0; i < quality.views.size(); ++i) {
    const TargetView& view = quality.views[i];
    const double x = kLeft + kCellWidth * static_cast<double>(i % directions);
    const double y = kTop + kCellHeight * static_cast<double>(rows - 1 - i / directions);
    text += fmt::format(
        "<rect x=\"{:.0f}\" y=\"{:.0f}\" width=\"{:.0f}\" height=\"{:.0f}\" fill=\"{}\"><title>phi "
        "{:.0f} deg, {:.2f} m high: {} sides, weakest {:.1f} mm</title></rect>\n",
        x, y, kCellWidth - 1, kCellHeight - 1,
        view.sides_fix_pose ? Colour(view.weakest_m) : std::string("#fff"), view.phi_deg,
        view.height_m, view.sides, 1000 * view.weakest_m);
    const bool unique = std::all_of(view.look_alike.begin(), view.look_alike.end(), [&](int alias) {
      return quality.aliases[static_cast<std::size_t>(alias)].floor_tells;
    });
    const char* mark = !view.sides_fix_pose ? "×" : (unique ? "" : "?");
    if (*mark) {
      text += fmt::format(
          "<circle cx=\"{0:.1f}\" cy=\"{1:.1f}\" r=\"6.5\" fill=\"#fff\"/><text class=\"mark\" "
          "x=\"{0:.1f}\" y=\"{2:.1f}\">{3}</text>\n",
          x + kCellWidth / 2 - 0.5, y + kCellHeight / 2, y + kCellHeight / 2 + 4.5, mark);
    }
  }
  for (std::size_t r = 0; r < rows; ++r) {
    text += fmt::format("<text text-anchor=\"end\" x=\"{:.0f}\" y=\"{:.0f}\">{} m</text>\n",
                        kLeft - 8, kTop + kCellHeight * (static_cast<double>(rows - 1 - r) + 0.6),
                        quality.options.heights_m[r]);
  }
  for (int deg = 0; deg <= 360; deg += 45) {
    text += fmt::format("<text text-anchor=\"middle\" x=\"{:.1f}\" y=\"{:.0f}\">{}°</text>\n",
                        kLeft + kCellWidth * quality.options.directions * deg / 360.0,
                        kTop + kCellHeight * static_cast<double>(rows) + 16, deg);
  }
  return text;
}

std::string Scale(double x, double y) {
  std::string text;
  constexpr int kSteps = 40;
  for (int i = 0; i < kSteps; ++i) {
    const double sigma = kBestSigma * std::pow(kWorstSigma / kBestSigma, (i + 0.5) / kSteps);
    text +=
        fmt::format("<rect x=\"{:.1f}\" y=\"{:.0f}\" width=\"5.5\" height=\"14\" fill=\"{}\"/>\n",
                    x + 5 * i, y, Colour(sigma));
  }
  return text + fmt::format(
                    "<text x=\"{0:.0f}\" y=\"{2:.0f}\">{3:.0f} mm</text><text text-anchor=\"end\" "
                    "x=\"{1:.0f}\" y=\"{2:.0f}\">{4:.0f} mm</text>\n"
                    "<text x=\"{5:.0f}\" y=\"{6:.0f}\">standard deviation of the position in "
                    "its weakest direction</text>\n",
                    x, x + 5 * kSteps, y + 28, 1000 * kBestSigma, 1000 * kWorstSigma, x, y - 8);
}

/// The stack from above, with the directions that the cells count.
std::string Plan(const Structure& structure, double left, double top) {
  double reach = 0.1;
  for (const Side& side : structure.sides()) {
    reach = std::max({reach, std::abs(side.centre.x()) + side.half_u + side.half_v,
                      std::abs(side.centre.z()) + side.half_u + side.half_v});
  }
  const double pixels = 0.36 * kPlanSize / reach;
  const double x = left + kPlanSize / 2, y = top + kPlanSize / 2;
  std::string text;
  for (const Box& box : structure.boxes()) {
    text += "<polygon class=\"box\" points=\"";
    for (const auto& [a, b] : {std::pair{-0.5, -0.5}, {0.5, -0.5}, {0.5, 0.5}, {-0.5, 0.5}}) {
      const Eigen::Vector3d corner =
          box.structure_from_box * Eigen::Vector3d(a * box.size.x(), 0, b * box.size.z());
      text += fmt::format("{:.1f},{:.1f} ", x + pixels * corner.x(), y + pixels * corner.z());
    }
    text += fmt::format("\"><title>{}</title></polygon>\n", box.name);
  }
  for (int deg = 0; deg < 360; deg += 45) {
    const double c = std::cos(deg * M_PI / 180), s = std::sin(deg * M_PI / 180);
    text += fmt::format(
        "<path class=\"axis\" d=\"M{:.1f},{:.1f} L{:.1f},{:.1f}\"/><text text-anchor=\"middle\" "
        "x=\"{:.1f}\" y=\"{:.1f}\">{}°</text>\n",
        x + 0.38 * kPlanSize * c, y + 0.38 * kPlanSize * s, x + 0.42 * kPlanSize * c,
        y + 0.42 * kPlanSize * s, x + 0.49 * kPlanSize * c, y + 0.49 * kPlanSize * s + 4, deg);
  }
  return text + fmt::format(
                    "<path class=\"axis\" d=\"M{0:.1f},{1:.1f} h40 M{0:.1f},{1:.1f} v40\"/><text "
                    "x=\"{2:.1f}\" y=\"{3:.1f}\">x</text><text x=\"{4:.1f}\" "
                    "y=\"{5:.1f}\">z</text>\n",
                    x, y, x + 44, y + 4, x - 4, y + 54);
}

}  // namespace

std::string TargetPicture(const Structure& structure, const TargetQuality& quality) {
  const double cells_width = kCellWidth * quality.options.directions;
  const double cells_height = kCellHeight * static_cast<double>(quality.options.heights_m.size());
  const double below = kTop + cells_height + 40;
  const double width = kLeft + std::max(cells_width, 650.0) + 30;
  std::string text = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0:.0f}\" height=\"{1:.0f}\" viewBox=\"0 "
      "0 {0:.0f} {1:.0f}\">\n<style>text{{font:13px sans-serif;fill:#222}}"
      ".mark{{font-weight:bold;text-anchor:middle}}"
      ".title{{font-size:15px;font-weight:bold}}.box{{fill:#999;fill-opacity:.35;stroke:#444}}"
      ".axis{{fill:none;stroke:#222}}</style>\n"
      "<rect width=\"{0:.0f}\" height=\"{1:.0f}\" fill=\"#fff\"/>\n"
      "<text class=\"title\" x=\"{2:.0f}\" y=\"24\">{3} as a target, seen from {4} m</text>\n"
      "<text x=\"{2:.0f}\" y=\"46\">direction (from +x towards +z) by height above the "
      "floor</text>\n",
      width, below + kPlanSize + 20, kLeft, structure.name(), quality.options.distance_m);
  text += Cells(quality) + Plan(structure, kLeft, below + 8);
  const double x = kLeft + kPlanSize + 40;
  text += Scale(x, below + 36);
  text += fmt::format(
      "<text x=\"{0:.0f}\" y=\"{1:.0f}\"><tspan font-weight=\"bold\">×</tspan> the sides in view "
      "fix "
      "no pose</text>\n<text x=\"{0:.0f}\" y=\"{2:.0f}\"><tspan font-weight=\"bold\">?</tspan> "
      "another pose of the stack looks the same, floor and all</text>\n<text x=\"{0:.0f}\" "
      "y=\"{3:.0f}\">left: "
      "the stack from above</text>\n",
      x, below + 100, below + 124, below + 148);
  return text + "</svg>\n";
}

}  // namespace volalign
