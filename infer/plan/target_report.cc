#include "infer/plan/target_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cstddef>
#include <set>
#include <string>
#include <vector>

#include "core/base/statistics.h"
#include "core/geometry/stack_faults.h"

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

}  // namespace volalign
