#include "infer/plan/target_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstddef>
#include <set>
#include <string>
#include <vector>

#include "core/base/statistics.h"
#include "core/geometry/stack_faults.h"
#include "core/plot/rig_from_above.h"
#include "core/plot/svg.h"

namespace volalign {

namespace {

constexpr double kMostUnfixed = 0.05;  // share of the views

double Share(int count, std::size_t of) {
  return of > 0 ? static_cast<double>(count) / static_cast<double>(of) : 0;
}

std::string Symmetries(const Structure& structure, const TargetQuality& quality) {
  const char* parts = structure.IsOfBoxes() ? "boxes" : "parts";
  std::string text;
  std::set<std::string> said;  // several motions may be described alike
  for (std::size_t k = 0; k < quality.symmetries.size(); ++k) {
    const TargetSymmetry& symmetry = quality.symmetries[k];
    const auto alike =
        std::count_if(quality.views.begin(), quality.views.end(), [&](const TargetView& view) {
          return std::find(view.look_alike.begin(), view.look_alike.end(), static_cast<int>(k)) !=
                 view.look_alike.end();
        });
    if ((alike == 0 && !symmetry.all) || !said.insert(symmetry.motion).second) continue;
    const double share = Share(static_cast<int>(alike), quality.views.size());
    text += fmt::format(
        "{}{}, {}the stack looks the same from {}{}.\n",
        static_cast<char>(std::toupper(static_cast<unsigned char>(symmetry.motion[0]))),
        symmetry.motion.substr(1),
        symmetry.all ? ""
                     : fmt::format("{} of its {} {} lie where {} lay, and ", symmetry.boxes,
                                   structure.boxes().size(), parts, parts),
        share == 1 ? "every direction" : fmt::format("{:.0f} % of the directions", 100 * share),
        symmetry.floor_tells ? "; only the floor tells the two apart" : "");
  }
  return text.empty() ? "The stack has no symmetries.\n" : text;
}

/// Does no other pose look the same? `floor`: the floor is seen.
bool IsUnique(const TargetView& view, const TargetQuality& quality, bool floor) {
  return std::none_of(view.look_alike.begin(), view.look_alike.end(), [&](int symmetry) {
    return !floor || !quality.symmetries[static_cast<std::size_t>(symmetry)].floor_tells;
  });
}

std::string HeightTable(const TargetQuality& quality) {
  return FormatTable(TargetTable(quality), TableFormat::kText) +
         fmt::format(
             "views: from {} directions, {} m from the middle\nfix pose: share of the views whose "
             "visible sides determine the pose\nunique: share of the views that cannot be taken "
             "for another pose, with the floor in view\nno floor: the same without the "
             "floor\nsides from, to: the fewest and the most sides that a view shows\nweakest, "
             "worst: standard deviation of the position in its worst direction, of the median view "
             "and of the worst one\nassumed errors: 5 mm per patch of 10 x 10 px, a pixel per 10 "
             "px of a silhouette\n",
             quality.options.directions, quality.options.distance_m);
}

std::string Conclusion(const Structure& structure, const TargetQuality& quality) {
  int open = 0, alike = 0, alike_without_floor = 0;
  for (const TargetView& view : quality.views) {
    open += !view.sides_fix_pose;
    alike_without_floor += !IsUnique(view, quality, false);
    alike += !IsUnique(view, quality, true);
  }
  const std::size_t all = quality.views.size();
  std::string text;
  for (const StackFault& fault : FindStackFaults(structure))
    text += fmt::format("{}: {}\n", fault.impossible ? "impossible" : "doubtful", fault.text);
  if (alike > 0) {
    text += fmt::format(
        "poor: from {:.0f} % of the places another pose looks the same, with or without the floor. "
        "Sensors there will be ambiguous. {}\n",
        100 * Share(alike, all),
        structure.IsOfBoxes()
            ? "Move or turn a box so that no turn of the stack looks like another"
            : "Take an object that looks like itself from one way only, or stand a box beside it");
  }
  if (Share(open, all) > kMostUnfixed) {
    text += fmt::format(
        "poor: {:.0f} % of the views do not determine a pose. {}\n", 100 * Share(open, all),
        structure.IsOfBoxes()
            ? "Let boxes stick out in both horizontal directions, so that every view has sides of "
              "three orientations"
            : "Take an object that shows flat sides of three orientations in every view");
  }
  if (text.empty())
    text = "good: every view fits one pose only, and nearly all views determine it\n";
  if (alike_without_floor > alike) {
    text += fmt::format(
        "let sensors see the floor beside the stack: without it, {:.0f} % of the views look like "
        "those of another pose\n",
        100 * Share(alike_without_floor, all));
  }
  return text;
}

}  // namespace

Table TargetTable(const TargetQuality& quality) {
  Table table;
  table.columns = {{"height_m", "height m", 1, 2},
                   {"fix_pose", "fix pose %", 100, 0},
                   {"unique", "unique %", 100, 0},
                   {"unique_without_floor", "no floor %", 100, 0},
                   {"least_sides", "sides from"},
                   {"most_sides", "to"},
                   {"weakest_median_m", "weakest mm", 1000, 1},
                   {"weakest_worst_m", "worst mm", 1000, 1}};
  for (const double height : quality.options.heights_m) {
    int fixed = 0, unique = 0, without_floor = 0, least = 1000, most = 0;
    std::vector<double> weakest;
    for (const TargetView& view : quality.views) {
      if (view.height_m != height) continue;
      fixed += view.sides_fix_pose;
      unique += IsUnique(view, quality, true);
      without_floor += IsUnique(view, quality, false);
      least = std::min(least, view.sides);
      most = std::max(most, view.sides);
      weakest.push_back(view.weakest_m);
    }
    table.rows.push_back({height, Share(fixed, weakest.size()), Share(unique, weakest.size()),
                          Share(without_floor, weakest.size()), CellOf(least), CellOf(most),
                          Quantile(weakest, 0.5), Quantile(weakest, 1)});
  }
  return table;
}

std::string FormatTarget(const Structure& structure, const TargetQuality& quality) {
  const Eigen::Vector3d above(0, structure.FloorHeight(), 0);
  return fmt::format(
             "{}: {}, {:.0f} mm high; the origin is {:.0f} mm above the floor. Poses are in "
             "its frame: +y is up, and training, rendering and rigs place sensors about it\n",
             structure.name(), structure.CountedParts(), 1000 * structure.Height(),
             -1000 * above.y()) +
         Symmetries(structure, quality) + HeightTable(quality) + Conclusion(structure, quality);
}

namespace {

constexpr double kCellWidth = 16, kCellHeight = 34;       // px
constexpr double kLeft = 70, kTop = 60;                   // px, of the cells
constexpr double kBestSigma = 0.001, kWorstSigma = 0.02;  // m, ends of the colour scale
constexpr double kPlanSize = 240;                         // px

/// From yellow (well known) to dark blue, evenly in lightness: the ends of the cividis scale, which
/// people with any colour vision can read.
std::string Colour(double sigma_m) {
  const double t =
      std::clamp(std::log(sigma_m / kBestSigma) / std::log(kWorstSigma / kBestSigma), 0.0, 1.0);
  const auto mix = [t](int from, int to) { return static_cast<int>(from + t * (to - from)); };
  return fmt::format("#{:02x}{:02x}{:02x}", mix(0xfd, 0x00), mix(0xe7, 0x22), mix(0x37, 0x4e));
}

void DrawCells(const TargetQuality& quality, Svg* svg) {
  const auto directions = static_cast<std::size_t>(quality.options.directions);
  const std::size_t rows = quality.options.heights_m.size();
  for (std::size_t i = 0; i < quality.views.size(); ++i) {
    const TargetView& view = quality.views[i];
    const std::size_t row = i / directions, column = i % directions;
    const double x = kLeft + kCellWidth * static_cast<double>(column);
    const double y = kTop + kCellHeight * static_cast<double>(rows - 1 - row);
    svg->Rectangle(
        {x, y}, kCellWidth - 1, kCellHeight - 1,
        fmt::format("fill=\"{}\"", view.sides_fix_pose ? Colour(view.weakest_m) : "#fff"),
        fmt::format("phi {:.0f} deg, {:.2f} m high: {} sides, weakest {:.1f} mm", view.phi_deg,
                    view.height_m, view.sides, 1000 * view.weakest_m));
    const bool unique =
        std::all_of(view.look_alike.begin(), view.look_alike.end(), [&](int symmetry) {
          return quality.symmetries[static_cast<std::size_t>(symmetry)].floor_tells;
        });
    if (view.sides_fix_pose && unique) continue;
    const Svg::Point centre{x + kCellWidth / 2 - 0.5, y + kCellHeight / 2};
    svg->Circle(centre, 6.5, "fill=\"#fff\"");
    svg->Text({centre.x, centre.y + 4.5}, view.sides_fix_pose ? "?" : "×",
              "text-anchor=\"middle\" font-weight=\"bold\"");
  }
  for (std::size_t r = 0; r < rows; ++r) {
    svg->Text({kLeft - 8, kTop + kCellHeight * (static_cast<double>(rows - 1 - r) + 0.6)},
              fmt::format("{} m", quality.options.heights_m[r]), "text-anchor=\"end\"");
  }
  for (int deg = 0; deg <= 360; deg += 45) {
    svg->Text({kLeft + kCellWidth * quality.options.directions * deg / 360.0,
               kTop + kCellHeight * static_cast<double>(rows) + 16},
              fmt::format("{}°", deg), "text-anchor=\"middle\"");
  }
}

void DrawScale(double x, double y, Svg* svg) {
  constexpr int kSteps = 40;
  for (int i = 0; i < kSteps; ++i) {
    const double sigma = kBestSigma * std::pow(kWorstSigma / kBestSigma, (i + 0.5) / kSteps);
    svg->Rectangle({x + 5 * i, y}, 5.5, 14, fmt::format("fill=\"{}\"", Colour(sigma)));
  }
  svg->Text({x, y + 28}, fmt::format("{:.0f} mm", 1000 * kBestSigma));
  svg->Text({x + 5 * kSteps, y + 28}, fmt::format("{:.0f} mm", 1000 * kWorstSigma),
            "text-anchor=\"end\"");
  svg->Text({x, y - 8}, "standard deviation of the position in its weakest direction");
}

/// The stack from above, with the directions that the cells count.
void DrawPlan(const Structure& structure, double left, double top, Svg* svg) {
  double reach = 0.1;
  for (const Side& side : structure.sides()) {
    reach = std::max({reach, std::abs(side.centre.x()) + side.half_u + side.half_v,
                      std::abs(side.centre.z()) + side.half_u + side.half_v});
  }
  const double pixels = 0.36 * kPlanSize / reach;
  const double x = left + kPlanSize / 2, y = top + kPlanSize / 2;
  const auto place = [&](const Eigen::Vector3d& p) {
    return Svg::Point{x + pixels * p.x(), y + pixels * p.z()};
  };
  for (const Box& part : structure.boxes()) DrawFromAbove(part, place, "box", svg);
  for (int deg = 0; deg < 360; deg += 45) {
    const auto at = [&, c = std::cos(deg * kDegree), s = std::sin(deg * kDegree)](double share) {
      return Svg::Point{x + share * kPlanSize * c, y + share * kPlanSize * s};
    };
    svg->Line(at(0.38), at(0.42), "class=\"axis\"");
    const Svg::Point text = at(0.49);
    svg->Text({text.x, text.y + 4}, fmt::format("{}°", deg), "text-anchor=\"middle\"");
  }
  DrawAxes({x, y}, 40, svg);
}

}  // namespace

std::string TargetPicture(const Structure& structure, const TargetQuality& quality) {
  const double cells_width = kCellWidth * quality.options.directions;
  const double cells_height = kCellHeight * static_cast<double>(quality.options.heights_m.size());
  const double below = kTop + cells_height + 40;
  Svg svg(kLeft + std::max(cells_width, 650.0) + 30, below + kPlanSize + 20,
          ".box{fill:#999;fill-opacity:.35;stroke:#444}.axis{stroke:#222}");
  svg.Text(
      {kLeft, 24},
      fmt::format("{} as a target, seen from {} m", structure.name(), quality.options.distance_m),
      "font-size=\"15\" font-weight=\"bold\"");
  svg.Text({kLeft, 46}, "direction (from +x towards +z) by height above the floor");
  DrawCells(quality, &svg);
  DrawPlan(structure, kLeft, below + 8, &svg);
  const double x = kLeft + kPlanSize + 40;
  DrawScale(x, below + 36, &svg);
  svg.Text({x, below + 100}, "× the sides in view do not determine a pose");
  svg.Text({x, below + 124}, "? another pose of the stack looks the same, floor and all");
  svg.Text({x, below + 148}, "left: the stack from above");
  return svg.Finished();
}

}  // namespace volalign
