#include "infer/evaluate/items.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cctype>
#include <set>
#include <utility>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/input_file.h"
#include "core/base/text.h"
#include "core/geometry/procrustes.h"
#include "core/geometry/structure.h"
#include "infer/capture/capture.h"
#include "render/depth_renderer.h"

namespace volalign {

namespace {

constexpr char kAsTheRig[] = "as the rig";
/// deg between seeds: consecutive multiples of the golden angle never bunch.
constexpr double kGoldenAngleDeg = 137.50776405003785;

std::vector<Eigen::Vector3d> Corners(const Structure& structure) {
  std::vector<Eigen::Vector3d> corners;
  for (const Box& box : structure.boxes()) {
    for (const Eigen::Vector3d& corner : box.Corners()) corners.push_back(corner);
  }
  return corners;
}

/// "configs/rig_ring8.yaml" -> "ring8"
std::string RigName(const std::string& path) {
  const std::string stem = std::filesystem::path(path).stem().string();
  return stem.rfind("rig_", 0) == 0 ? stem.substr(4) : stem;
}

/// Drops or draws placements until the structure has `count` places.
void SetPlacements(int count, double radius_m, Rig* rig) {
  const auto further = static_cast<std::size_t>(count - 1);
  const std::size_t own = std::min(rig->placements.size(), further);
  rig->placements.resize(own);
  if (own == further) return;
  for (const RigPlacement& placement :
       DrawPlacements(*rig, static_cast<int>(further - own), radius_m)) {
    rig->placements.push_back(placement);
  }
}

}  // namespace

EvaluationCapture EvaluationCaptureOf(const RigCapture& rendered) {
  EvaluationCapture capture;
  capture.structure = rendered.structure;
  for (const CapturedSensor& sensor : rendered.sensors) {
    SensorFrame frame;
    frame.name = sensor.name;
    frame.depth = sensor.depth;
    frame.intrinsics = sensor.stated_intrinsics;
    frame.sensor = sensor.sensor;
    if (rendered.structure_present) frame.ground_truth = sensor.structure_from_sensor;
    capture.frames.push_back(std::move(frame));
    capture.labels.push_back(sensor.labels);
  }
  const Structure built = rendered.structure.Displaced(rendered.box_offsets, rendered.size_scale);
  capture.nominal_from_built =
      AlignPoints(Corners(built), Corners(rendered.structure)).target_from_source;
  return capture;
}

EvaluationCapture EvaluationCaptureOf(const std::vector<RigCapture>& placements) {
  EvaluationCapture capture = EvaluationCaptureOf(placements.front());
  for (std::size_t k = 1; k < placements.size(); ++k) {
    EvaluationCapture other = EvaluationCaptureOf(placements[k]);
    capture.further.push_back({std::move(other.frames), std::move(other.labels)});
  }
  return capture;
}

EvaluationItem RigItem(const std::string& name, Rig rig, const std::string& sensors,
                       DepthRenderer* renderer) {
  EvaluationItem item;
  item.rig = name;
  item.sensors = sensors.empty() ? kAsTheRig : sensors;
  item.seed = rig.seed;
  item.placements = static_cast<int>(rig.placements.size()) + 1;
  if (!sensors.empty()) {
    for (RigSensor& sensor : rig.sensors) {
      sensor.sensor = sensors;
      sensor.image_size.clear();
    }
  }
  item.identity = WriteConfig(rig) + ReadStructure(rig.structure).Hash() +
                  Sha256(ReadFile(FindInputFile(rig.intrinsics), kMaxTextBytes));
  item.load = [rig, renderer] { return EvaluationCaptureOf(RenderPlacements(rig, *renderer)); };
  return item;
}

EvaluationItem CaptureItem(const std::filesystem::path& path, const Structure& structure) {
  const CaptureFile source = ReadCapture(path);
  EvaluationItem item;
  item.rig = path.string();
  item.identity = Sha256(ReadFile(path, kMaxTextBytes));
  for (const SensorFrame& frame : source.sensors) {
    for (const std::string& file : frame.depth_files) {
      item.identity += Sha256(ReadFile(path.parent_path() / file, kMaxRecordingBytes));
    }
    // Intrinsics may come from another file.
    const Intrinsics& k = frame.intrinsics;
    item.identity +=
        fmt::format(" {} {} {} {} {}", k.fx, k.fy, k.cx, k.cy, fmt::join(k.distortion, " "));
  }
  EvaluationCapture capture;
  capture.structure = source.structure ? ReadStructure(source.structure->string()) : structure;
  item.identity += capture.structure.Hash();
  capture.frames = source.sensors;
  item.load = [capture] { return capture; };
  return item;
}

std::vector<NamedRig> ReadRigs(const RigSeries& series) {
  std::vector<NamedRig> rigs;
  std::set<std::string> names;
  for (const std::string& path : series.files) {
    if (!names.insert(RigName(path)).second) {
      throw ConfigError(fmt::format("--rig: two are named {}", RigName(path)));
    }
    ConfigSource source = ConfigSource::FromFile(path);
    for (const std::string& change : series.changes) source.Set(change);
    rigs.push_back({RigName(path), ReadRig(source)});
  }
  return rigs;
}

std::vector<EvaluationItem> RigItems(const std::vector<NamedRig>& rigs, const RigSeries& series,
                                     DepthRenderer* renderer) {
  const std::vector<std::string> own_sensors{""};
  std::vector<EvaluationItem> items;
  for (const NamedRig& named : rigs) {
    const std::vector<std::uint64_t> own_seed{named.rig.seed};
    const std::vector<int> own_placements{static_cast<int>(named.rig.placements.size()) + 1};
    for (const std::string& sensors : series.sensors.empty() ? own_sensors : series.sensors) {
      for (const int count : series.placements.empty() ? own_placements : series.placements) {
        for (const std::uint64_t seed : series.seeds.empty() ? own_seed : series.seeds) {
          Rig rig = named.rig;
          rig.seed = seed;
          if (!series.keep_yaw) {
            TurnStructure(kGoldenAngleDeg * static_cast<double>(seed), &rig);
          }
          for (Rig& turn : Turns(rig)) {
            SetPlacements(count, series.placement_radius_m, &turn);
            items.push_back(RigItem(named.name, turn, sensors, renderer));
          }
        }
      }
    }
  }
  return items;
}

std::vector<std::uint64_t> ParseSeeds(const std::string& text) {
  const auto fail = [&]() -> ConfigError {
    return ConfigError(fmt::format(
        "--seeds {}: FIRST:END (END not included), or numbers with commas, e.g. 1000:1020", text));
  };
  const auto number = [&](const std::string& part) {
    if (part.empty() || part.size() > 18 ||
        !std::all_of(part.begin(), part.end(), [](unsigned char c) { return std::isdigit(c); })) {
      throw fail();
    }
    return static_cast<std::uint64_t>(std::stoull(part));
  };
  std::vector<std::uint64_t> seeds;
  const std::size_t colon = text.find(':');
  if (colon != std::string::npos) {
    const std::uint64_t first = number(text.substr(0, colon)), end = number(text.substr(colon + 1));
    constexpr std::uint64_t kMost = 1000000;
    if (end <= first || end - first > kMost) throw fail();
    for (std::uint64_t seed = first; seed < end; ++seed) seeds.push_back(seed);
    return seeds;
  }
  std::set<std::uint64_t> unique;
  for (const std::string& part : Split(text, ',')) {
    seeds.push_back(number(part));
    if (!unique.insert(seeds.back()).second) throw fail();
  }
  return seeds;
}

}  // namespace volalign
