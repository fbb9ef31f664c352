// How long the search for a first pose without a network takes (infer/initial/geometry_search.h),
// one frame at a time on one thread.
//
//   geometry_time CAPTURE.json...
//
// A capture has to name its structure. Printed as Markdown, for each size of the frames: the
// processor's time, ms, of frames in which the structure was found and of those in which it was
// not, the least of three runs each.

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "core/geometry/structure.h"
#include "infer/capture/capture.h"
#include "infer/initial/geometry_search.h"
#include "tests/bench/program.h"

namespace volalign {
namespace {

constexpr int kRuns = 3;

struct Times {
  std::vector<double> found, not_found;
};

std::string Cell(std::vector<double> values) {
  if (values.empty()) return "-";
  std::sort(values.begin(), values.end());
  const auto at = [&](double q) {
    return values[std::min(values.size() - 1,
                           static_cast<std::size_t>(q * static_cast<double>(values.size())))];
  };
  return fmt::format("{:.0f} / {:.0f} / {:.0f} ({})", at(0.5), at(0.95), values.back(),
                     values.size());
}

void Measure(const std::string& path, bool verbose, std::map<std::string, Times>* times) {
  const Capture capture = ReadCapture(path);
  const Structure structure = ReadStructure(capture.structure.value().string());
  const std::vector<StructureAlias> aliases = FindAliases(structure);
  for (const SensorFrame& frame : capture.sensors) {
    const SensorView view = MakeSensorView(frame.depth, frame.intrinsics);
    double least = std::numeric_limits<double>::infinity();
    bool found = false;
    for (int run = 0; run < kRuns; ++run) {
      const double before = 1e3 * ThreadSeconds();
      found = !FindPosesByGeometry(view, structure, aliases).empty();
      least = std::min(least, 1e3 * ThreadSeconds() - before);
    }
    Times& of_size = (*times)[fmt::format("{}x{}", view.width(), view.height())];
    (found ? of_size.found : of_size.not_found).push_back(least);
    if (verbose) fmt::print("{} {}: {:.0f} ms, {}\n", path, frame.name, least, found);
  }
}

int Run(const std::vector<std::string>& arguments) {
  std::map<std::string, Times> times;
  bool verbose = false;
  for (const std::string& path : arguments) {
    if (path == "-v") {
      verbose = true;
    } else {
      Measure(path, verbose, &times);
    }
  }
  fmt::print(
      "| frame | found: ms, median / 95 % / largest (frames) | not found |\n|---|---|---|\n");
  for (const auto& [size, of_size] : times)
    fmt::print("| {} | {} | {} |\n", size, Cell(of_size.found), Cell(of_size.not_found));
  return 0;
}

}  // namespace
}  // namespace volalign

int main(int argc, char** argv) {
  return volalign::StatusOf([&] { return volalign::Run({argv + 1, argv + argc}); });
}
