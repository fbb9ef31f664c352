#include "infer/checks/hints.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <vector>

#include "infer/view/alike.h"

namespace volalign {

namespace {

/// Share of a border's length that labels have to reach if it cuts the structure off.
constexpr double kCutShare = 0.1;

/// Borders of the stored image (0 left, 1 top, 2 right, 3 bottom) that labels reach.
std::vector<int> CuttingBorders(const LabelImage& labels) {
  const int w = labels.width(), h = labels.height();
  std::vector<int> cut;
  for (int border = 0; border < 4; ++border) {
    const bool upright = border % 2 == 0;
    const int length = upright ? h : w, across_length = upright ? w : h;
    int marked = 0;
    for (int along = 0; along < length; ++along) {
      bool any = false;
      for (int d = 0; d < std::min(kEmptyBorder, across_length); ++d) {
        const int across = border < 2 ? d : across_length - 1 - d;
        any = any || (upright ? labels(across, along) : labels(along, across)) > 0;
      }
      marked += any ? 1 : 0;
    }
    if (marked >= kCutShare * length) cut.push_back(border);
  }
  return cut;
}

}  // namespace

std::string MoveHint(const LabelImage& labels) {
  const std::vector<int> cut = CuttingBorders(labels);
  if (cut.empty()) {
    return "move the sensor round the structure to the left or right, or up, until it sees sides "
           "of two orientations or more";
  }
  if (cut.size() > 1) {
    return "move the sensor further away, or turn it so that it sees most of the structure: the "
           "image border cuts the structure off";
  }
  static constexpr const char* kNames[] = {"left", "upper", "right", "lower"};
  return fmt::format(
      "the {} border of its stored picture cuts the structure off: turn the sensor so that it sees "
      "what is beyond that border, or move it further away",
      kNames[cut.front()]);
}

}  // namespace volalign
